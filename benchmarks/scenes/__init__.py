"""Programs that make the models which ship as files: `scenes/room.glb` and `scenes/parlour.glb`."""

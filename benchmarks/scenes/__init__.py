"""Programs that make the shipped models `scenes/room.glb` and `scenes/parlour.glb`, and scenes of benches."""

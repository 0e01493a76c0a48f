"""What benches and figures share: how they time, and how they judge."""

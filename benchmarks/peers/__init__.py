"""Other people's programs, each at its best settings on a scene of ours."""

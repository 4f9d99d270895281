"""What each `gcl` command takes; loads nothing heavy, so that help and completion come at once."""

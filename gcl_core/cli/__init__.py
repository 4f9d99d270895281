"""The `gcl` command: one thin file for each subcommand."""

"""The commands of `bipot`, a file a command: its arguments, and what it calls."""

"""What each command of `bipot` does, a file a command; `cli` has their arguments."""

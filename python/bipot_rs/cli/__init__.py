"""The command `bipot`: arguments in `app`, one file a command in `commands`."""

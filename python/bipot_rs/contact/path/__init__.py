"""Load steps and load paths, and the engines that solve them."""

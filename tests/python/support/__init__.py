"""Problems, oracles and child processes that several tests use."""

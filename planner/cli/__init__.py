"""The command `planner`: `app` starts it, each other file holds the commands of one subject."""

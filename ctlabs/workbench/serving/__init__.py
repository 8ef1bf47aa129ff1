"""The server: the command, what listens, and the guard around it."""

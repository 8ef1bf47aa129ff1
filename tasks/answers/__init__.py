"""The answers of the labs by hand: the second route of their checks. Nothing here imports the library."""

"""The labs: the catalogue, the standard experiment, the portrait of a filter."""

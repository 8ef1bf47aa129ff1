"""A course from one roster: personal variants of the labs, their keys, what students hand in, and its grading."""

"""Atoms of linear algebra that know no model."""

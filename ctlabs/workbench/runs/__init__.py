"""Experiments and labs as they run: in processes of their own, what comes out, its figures, reports and files."""

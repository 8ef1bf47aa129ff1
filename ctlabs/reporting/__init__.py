"""From results to documents: reports, pictures, parameters."""

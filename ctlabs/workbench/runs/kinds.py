"""What an experiment can be exported as."""

from __future__ import annotations

#: Endings of the files, and their types for a browser.
KINDS = {
    "html": ("html", "text/html"),
    "pdf": ("pdf", "application/pdf"),
    "csv": ("csv", "text/csv"),
    "parquet": ("parquet", "application/vnd.apache.parquet"),
    "json": ("json", "application/json"),
    "npz": ("npz", "application/octet-stream"),
    "mat": ("mat", "application/octet-stream"),
    "h": ("h", "text/x-c"),
    "png": ("png", "image/png"),
    "svg": ("svg", "image/svg+xml"),
    "python": ("py", "text/x-python"),
    "commands": ("sh", "application/x-sh"),
    "toml": ("toml", "application/toml"),
}
#: What each kind is a part of: the report, a table, gains, a picture, or the experiment as such.
TABLES, GAINS, PICTURES = ("csv", "parquet"), ("npz", "mat", "h"), ("png", "svg")

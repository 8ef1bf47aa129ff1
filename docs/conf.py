"""How the documentation is built: `make docs`, or `sphinx-build -W -n docs build/docs`."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

import ctlabs  # noqa: E402  (after the path: extensions and package are found alike)

project = "ctlabs"
author = copyright = "ctlabs developers"  # noqa: A001  (Sphinx's name)
version = release = ctlabs.__version__

extensions = [
    "sphinx.ext.autodoc",
    "myst_parser",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "equations",
    "docstrings",
    "generated",
    "links",
]
exclude_patterns = ["gallery/**", "extensions/**", "images/**"]
nitpicky = True

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_dmath_allow_digits = True
myst_heading_anchors = 3

html_theme = "furo"
html_title = "ctlabs"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
pygments_style, pygments_dark_style = "friendly", "monokai"

autodoc_typehints = "none"  # docstrings have shapes and units, which say more
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": r"\.py$",
    "subsection_order": [
        *(f"gallery/{name}" for name in ("noise", "filters", "smoothing", "data", "design", "regulators", "fields", "schedules")), "*",
    ],
    "within_subsection_order": "FileNameSortKey",
    "reset_modules": ("matplotlib", "gallery_style.styled"),
    "reset_modules_order": "before",
    "abort_on_example_error": True,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 3600,
    "plot_gallery": True,
    "write_computation_times": False,
    "image_srcset": ["2x"],
    "default_thumb_file": str(HERE / "images/model-light.png"),
}

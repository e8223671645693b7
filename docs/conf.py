"""How Sphinx builds these pages: `make docs`."""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

project = "orip"
author = "The orip developers"
release = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "program_reference",
    "offline_mathematics",
    "glossary_links",
]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes = False  # what a program says and what a user types have straight ones
exclude_patterns = ["extensions"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of parameters are words and shapes, and not all of them have a page
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say more: shapes and units
napoleon_google_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 88
suppress_warnings = ["misc.highlighting_failure"]  # a console block may show anything

html_theme = "furo"
html_title = f"orip {release}"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["page.css"]
html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False

man_pages = [("reference/commands/index", "orip", "bundle adjustment of photogrammetric project folders", author, 1)]

"""How Sphinx builds these pages: `make docs`. Nothing is fetched while it does."""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

with (HERE.parent / "Cargo.toml").open("rb") as file:
    release = tomllib.load(file)["package"]["version"]

project = "bipot_rs"
author = "the authors of bipot_rs"
project_copyright = author
language = "en"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "command_reference",
    "mathml",
    "outside_links",
    "tutorial_notebooks",
]
exclude_patterns = ["_extensions", "_static"]
# Single backticks in docstrings name things of Python, as in `ContactProblem`.
default_role = "py:obj"

# Links to headings are those of the web pages of a repository, so that the same file
# reads right in both places; pictures with a width are written as HTML there.
myst_heading_anchors = 4
myst_enable_extensions = ["html_image"]
# Formulas, which the web pages of a repository show too.
myst_fence_as_directive = ["math"]
html_math_renderer = "mathml"

# Shapes and units stand in the docstrings, where types would only repeat "array".
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
# `__all__` gives the public names; a class brings its methods.
autodoc_default_options = {"members": True}
autosummary_generate = False
napoleon_google_docstring = False
# A list of their own: as fields of Python each name would be a link, and some are
# names of several classes.
napoleon_custom_sections = [("Attributes", "params_style")]
napoleon_use_rtype = False
napoleon_preprocess_types = False

html_theme = "pydata_sphinx_theme"
html_title = f"bipot_rs {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
}
# Without pages below them they would have an empty column.
_alone = (
    "index",
    "start",
    "gallery",
    "trust",
    "limits",
    "scenes",
    "command-line",
    "cluster",
    "theory",
    "verification",
    "stability",
    "benchmarks",
    "comparison",
    "collection",
    "architecture",
    "compatibility",
    "building",
    "releasing",
    "changelog",
)
html_sidebars: dict[str, list[str]] = {page: [] for page in _alone}

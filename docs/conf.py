"""How Sphinx makes the site: `make docs`."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from cpic_planner import __version__  # noqa: E402
from tools.site.pages import make  # noqa: E402

make(HERE)

project = "cpic-planner"
author = copyright = "The cpic-planner team"
version = release = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "numpydoc", "tools.site.extension"]
exclude_patterns = ["_made", "_build"]
suppress_warnings = ["myst.header"]  # reports are sections of other documents, and begin at any level
nitpicky = True
default_role = "py:obj"

myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # notebooks are committed with their output; the tests execute them

autodoc_typehints = "none"  # types stand in the numpydoc sections, in words
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"cpic-planner {__version__}"
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
smartquotes = False  # -- begins an option

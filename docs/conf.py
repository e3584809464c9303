"""The manual: ``sphinx-build -W docs build`` from the root of the source."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from insnav import __version__

project = "insnav"
author = "The insnav founders"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "from_the_code"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
numpydoc_show_class_members = False
autodoc_typehints = "none"
math_numfig = True
numfig = True
math_eqref_format = "({number})"
exclude_patterns = ["_ext"]
html_theme = "pydata_sphinx_theme"
html_title = f"insnav {release}"
html_theme_options = {"show_nav_level": 1, "navigation_with_keys": False, "show_toc_level": 2}
html_sidebars = {"index": []}
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
smartquotes = False  # options begin with two hyphens

"""The manual: ``sphinx-build -W docs build`` from the root of the source."""

import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst, matplotlib_scraper

sys.path.insert(0, str(Path(__file__).parent / "_ext"))
sys.path.insert(0, str(Path(__file__).parents[1]))  # `tests.error_sites`

from insnav import __version__

project = "insnav"
author = "The insnav founders"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_gallery.gen_gallery", "from_the_code"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
numpydoc_show_class_members = False
autodoc_typehints = "none"
math_numfig = True
numfig = True
math_eqref_format = "({number})"
exclude_patterns = ["_ext", "gallery/README.txt", "gallery/*.py"]


def figures(block: tuple[object, ...], block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Pictures of a block: figures of pyplot, and one called ``figure`` that `Result.plot` gave."""
    found = matplotlib_scraper(block, block_vars, gallery_conf)
    drawn = block_vars["example_globals"].pop("figure", None)
    if found or not isinstance(drawn, Figure):
        return found
    path = next(block_vars["image_path_iterator"])
    drawn.savefig(path, dpi=80)
    return figure_rst([path], gallery_conf["src_dir"])


sphinx_gallery_conf = {
    "image_scrapers": (figures,),
    "ignore_repr_types": "matplotlib",
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",  # made by the build
    "download_all_examples": False,
    "show_memory": False,
    "min_reported_time": 3600,
}
html_theme = "pydata_sphinx_theme"
html_title = f"insnav {release}"
html_theme_options = {"show_nav_level": 1, "navigation_with_keys": False, "show_toc_level": 2}
html_sidebars = {"index": []}
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_js_files = ["messages.js"]
html_context = {"default_mode": "auto"}
smartquotes = False  # options begin with two hyphens
suppress_warnings = ["config.cache"]  # the scraper is a function

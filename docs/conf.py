"""The site of the docs: ``bash scripts/docs.sh`` builds it, ``scripts/test.sh`` without warnings.

Sphinx, as the ROS tools have it (rosdoc2), with MyST, as the pages are Markdown that also reads on
its own.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from herringbone_sim.version import VERSION

project = "herringbone_sim"
release = VERSION
html_title = f"herringbone_sim {VERSION}"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
exclude_patterns = ["blind/blind_*", "_build"]
html_theme = "furo"

myst_heading_anchors = 3
nb_execution_mode = "off"  # test_ways_in.py runs the notebooks; their outputs are kept

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autoclass_content = "class"
napoleon_google_docstring = True
napoleon_use_ivar = True
napoleon_use_param = False
napoleon_use_rtype = False

"""The pages of this folder as a site, which loads nothing from elsewhere: `make docs` writes it to build."""

import os
from importlib.metadata import version as version_of

# Compiled functions are no functions to whoever looks for docstrings; uncompiled they are.
os.environ["NUMBA_DISABLE_JIT"] = "1"

project = "coastarc"
version = release = version_of("coastarc")
copyright = "the authors of coastarc"
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
root_doc = "index"

# Headings are addressed as on the pages of a repository: [text](page.md#words-of-the-heading).
myst_heading_anchors = 4
# Indented lines in which equations stand are no code of any language.
highlight_language = "none"

# Shapes are written with the names of sizes, which several classes have; no link is meant.
suppress_warnings = ["ref.python"]

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "alphabetical"
autodoc_class_signature = "separated"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"coastarc {version}"
html_copy_source = False
html_show_sphinx = False

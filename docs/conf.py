"""Settings of Sphinx. `make docs` calls it by `.ci/docs.py`, which puts the pages together first."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from docutils import nodes
from sphinx.application import Sphinx

import glpath
from glpath_docs.python_api import docstring

project = "glpath"
author = "the authors of glpath"
project_copyright = "the authors of glpath, MIT licence"
version = release = glpath.__version__

extensions = ["sphinx.ext.autodoc", "myst_nb", "sphinx_copybutton", "glpath_docs.results", "glpath_docs.reading"]
root_doc = "index"
exclude_patterns = ["_ext"]
templates_path: list[str] = []

# Blocks of code may leave things out ("..."); tests run those that are whole.
suppress_warnings = ["misc.highlighting_failure"]

myst_enable_extensions = ["colon_fence", "deflist", "fieldlist", "dollarmath"]
myst_heading_anchors = 4
smartquotes = False  # of two hyphens, which begin an option, they make a dash
nb_execution_mode = "off"  # `make test` runs the notebooks, see `glpath_docs.notebooks`
nb_output_stderr = "remove"
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_typehints_format = "fully-qualified"
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"glpath {release}"
html_static_path = ["_static"]
html_css_files = ["glpath.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False
html_domain_indices = False


def setup(app: Sphinx) -> None:
    """Hand docstrings to autodoc in its own form, and mend what it writes."""

    def convert(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
        lines[:] = docstring(what, lines)

    def with_dashes(app: Sphinx, tree: nodes.document) -> None:
        """Between a parameter and its text Sphinx writes two hyphens."""
        for text in [each for each in tree.findall(nodes.Text) if each == " -- "]:
            text.parent.replace(text, nodes.Text(" \u2013 "))

    app.connect("autodoc-process-docstring", convert)
    app.connect("doctree-read", with_dashes)

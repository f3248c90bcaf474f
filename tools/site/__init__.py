"""Pages of the documentation that are made from the code, and what Sphinx needs of the project: see ``docs/conf.py``.

Each module makes the part of a page that its name says, as Markdown; the words around it stand in ``docs/``. Nothing
of this is installed, and all but `tools.site.extension` works without Sphinx.
"""

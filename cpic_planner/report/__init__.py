"""Reports: tables, figures, the HTML page and terminal tables; each name is imported from its module."""

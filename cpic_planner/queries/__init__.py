"""Questions that can be asked: one frozen model for each command.

A field of a question is declared once (`cpic_planner.queries.question.asked`). The options of the command, the keywords
of the Python function, the JSON Schema, the YAML file and the hash of a run all derive from it.
"""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

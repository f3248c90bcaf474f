"""The web calculator: questions as addresses, answers as pages and data. It needs the extra ``web``.

An address is the question: its parameters are the fields of the question, read as those of the command line. Nothing
is kept between requests but a few answers, and no request names a file.
"""

from cpic_core.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

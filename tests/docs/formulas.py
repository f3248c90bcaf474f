"""Formulas of pages as functions: enough of LaTeX to evaluate what stands there, and nothing that it does not read."""

import math
import re

_TOKEN = re.compile(r"\s+|\\[a-zA-Z]+|\\[,;! ]|\d+(?:\.\d+)?|[A-Za-z]|[-+*/=^_{}()]")
_SPACE = {r"\,", r"\;", r"\!", "\\ ", r"\left", r"\right"}
_FUNCTIONS = {r"\sin": math.sin, r"\cos": math.cos, r"\ln": math.log, r"\exp": math.exp}


def formulas(text):
    """Return the formulas of a page by their labels."""
    found = re.findall(r"```\{math\}\n:label: ([\w-]+)\n\n?(.*?)```", text, re.DOTALL)
    assert len(found) == text.count("```{math}"), "a formula has no label"
    return {label: formula.strip() for label, formula in found}


def evaluated(formula, values):
    """Return the right side of an equation for values by name: ``n_w`` as ``n_w``, Greek letters by their names."""
    reader = _Reader(formula.partition("=")[2], {"pi": math.pi, "e": math.e} | values)
    value = reader.sum()
    assert not reader.tokens, f"{formula}: {reader.tokens} is left over"
    return value


def _tokens(text):
    tokens, at = [], 0
    while at < len(text):
        found = _TOKEN.match(text, at)
        assert found, f"cannot read {text[at : at + 20]!r}"
        at = found.end()
        if not found[0].isspace() and found[0] not in _SPACE:
            tokens.append(found[0])
    return tokens


class _Reader:
    """Reads a formula from the left: sums of products of powers; what stands beside each other is multiplied."""

    def __init__(self, text, values):
        self.tokens, self.values = _tokens(text), values

    def next(self, wanted=""):
        token = self.tokens.pop(0)
        assert not wanted or token == wanted, f"{token} where {wanted} is expected"
        return token

    def sees(self, *tokens):
        return bool(self.tokens) and self.tokens[0] in tokens

    def sum(self):
        value = -self.product() if self.sees("-") and self.next() else self.product()
        while self.sees("+", "-"):
            value = value + self.product() if self.next() == "+" else value - self.product()
        return value

    def product(self):
        value = self.power()
        while self.tokens and not self.sees("+", "-", ")", "}", "="):
            value = value / self.power() if self.sees("/") and self.next() else value * self.power()
        return value

    def power(self):
        value = self.atom()
        if self.sees("^"):
            self.next()
            return value ** self.group()
        return value

    def group(self):
        """What stands in braces, or one token."""
        if not self.sees("{"):
            return self.atom()
        self.next()
        value = self.sum()
        self.next("}")
        return value

    def atom(self):
        token = self.next()
        if token == "(":
            value = self.sum()
            self.next(")")
            return value
        if token == r"\frac":
            return self.group() / self.group()
        if token == r"\sqrt":
            return self.group() ** 0.5
        if token == r"\sum":
            return self.series()
        if token in _FUNCTIONS:
            return _FUNCTIONS[token](self.power())
        if token[0].isdigit():
            return float(token)
        value = self.values[self.name(token)]
        return value(self.power()) if callable(value) else value

    def name(self, token):
        """Name of a quantity with its subscript."""
        own = token.lstrip("\\")
        if not self.sees("_"):
            return own
        self.next()
        if not self.sees("{"):
            return f"{own}_{self.next()}"
        self.next()
        inside = []
        while not self.sees("}"):
            inside.append(self.next())
        self.next("}")
        return f"{own}_{''.join(inside)}"

    def series(self):
        """``\\sum_{j=1}^{N} term``: the term is what is multiplied behind it."""
        self.next("_")
        self.next("{")
        index = self.next()
        self.next("=")
        first = self.sum()
        self.next("}")
        self.next("^")
        last, rest, total = self.group(), list(self.tokens), 0.0
        for number in range(round(first), round(last) + 1):
            self.tokens = list(rest)
            self.values = self.values | {index: float(number)}
            total += self.product()
        if round(last) < round(first):
            self.values = self.values | {index: first}
            self.product()
        return total

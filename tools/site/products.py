"""Keywords of Level-0 products, from the table that writes and checks them."""

from tools.site.markdown import Entry, anchored, code, prose, table

HEADINGS = ("keyword", "other spellings", "type", "unit", "where", "required", "confidence", "meaning")


def entries() -> list[Entry]:
    """Return the keywords of headers in the order of writing."""
    from simulator.products.keywords import load_keywords

    return [
        Entry(
            anchored("keyword", item.name),
            item.name,
            (
                ", ".join(map(code, item.aliases)),
                item.kind,
                code(item.unit),
                item.hdu,
                item.required,
                item.confidence,
                prose(item.comment) + (f" (section `{item.section}`)" if item.section else ""),
            ),
        )
        for item in load_keywords()
    ]


def page() -> str:
    """Return the reference of keywords."""
    return table(HEADINGS, entries())

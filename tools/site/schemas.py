"""The JSON Schemas that `cpic schema` prints: what each is about, and what stands at its top."""

import json

from tools.site.markdown import Entry, anchored, code, prose, table


def names() -> tuple[str, ...]:
    """Return the names of all schemas."""
    from cpic_planner.schemas import QUESTIONS, RESULTS

    return (*RESULTS, *(f"{command}-question" for command in QUESTIONS))


def page() -> str:
    """Return one row a schema."""
    from cpic_planner.schemas import schema_text

    rows = []
    for name in names():
        schema = json.loads(schema_text(name))
        said = prose(schema.get("description", "").split("\n\n")[0])
        fields = ", ".join(map(code, schema["properties"]))
        rows.append(Entry(anchored("schema", name), name, (said, fields)))
    return table(("schema", "what it describes", "fields at its top"), rows)

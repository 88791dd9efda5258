"""Options that commands share, in groups: frozen dataclasses, spread over a command's own options by every door.

    @dataclass(frozen=True, kw_only=True)
    class LensOptions:
        model: Annotated[str, Option("NAME")] = "brown"
        "Camera model: pinhole, brown, …"

A field is an option of the same name (- for _), its type says what it takes (`tuple[str, ...]`: any number of values),
the string below it is its help.
"""

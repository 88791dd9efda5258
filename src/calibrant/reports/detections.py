"""What was found in photos, as a terminal shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

    from calibrant.data import Observations, View


def table(found: Observations) -> Text:
    """Every photo in the order of its name: how many points of how many, or the reason why there are none."""
    from rich.cells import cell_len
    from rich.text import Text

    from calibrant.formats.poses.natural_order import natural_key

    total = _total(found)
    rows = {v.id: (f"{len(v)} of {total}", _noise(v), "found", "") for v in found.views}
    rows |= {m.id: ("0", "", f"not found: {m.reason}", "red") for m in found.missed}
    # One text: a table of Rich's own takes a millisecond a row, longer than to read what was found before.
    out = Text()
    out.append(f"{found.target}: found in {len(found.views)} of {len(rows)} photos\n\n", "bold")
    name_width = max(len("photo"), *(cell_len(name) for name in rows))
    count_width = max(len("points"), *(len(count) for count, *_ in rows.values()))
    out.append(f"{'photo':{name_width}}  {'points':>{count_width}}  {'1σ px':>7}\n", "dim")
    for name in sorted(rows, key=natural_key):
        count, noise, words, style = rows[name]
        out.append(f"{name}{' ' * (name_width - cell_len(name))}  {count:>{count_width}}  {noise:>7}  ")
        out.append(f"{words}\n", style)
    out.rstrip()
    for note in found.notes:
        out.append(f"\n\n{note}")
    return out


def _total(found: Observations) -> int:
    """How many points the target has; of own points, whose files are all that is known, how many were seen at all."""
    from calibrant.targets.point_folder import PointFolder
    from calibrant.targets.registry import parse_target

    target = parse_target(found.target) if found.target else None
    if target is None or isinstance(target, PointFolder):
        return len({label for view in found.views for label in view.point_ids.tolist()})
    return len(target.points)


def _noise(view: View) -> str:
    """The median of the detector's own sigma, where it states one."""
    if view.sigma_px is None:
        return ""
    ordered = sorted(view.sigma_px.tolist())
    return f"{ordered[len(ordered) // 2]:.2g}"

"""Check that a film to resume from belongs to the same render, with a report of all differences."""

from __future__ import annotations

from collections.abc import Collection

from glpath.errors import UsageError
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata, differences, shown
from glpath.system.log import log


class AnotherRenderError(UsageError):
    """Error for a film that belongs to another render; `reason` lists all differences."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"film: cannot be resumed: {reason}.",
            "Use the options of the film, or render without it.",
        )
        self.reason = reason


def check_same_render(
    film: Film, metadata: FilmMetadata, path_sets: tuple[int, int], unknown: Collection[str]
) -> None:
    """Raise AnotherRenderError, with all differences, unless a render with this metadata began the film.

    unknown : names of metadata, as in `differences`, that are not compared, because their values are not known yet

    Another device, driver or library is only logged. A render may move to another machine, but the sum is then not
    bit-identical to that of one device.
    """
    found = [pair for pair in differences(film.metadata, metadata) if pair[0] not in unknown]
    before, now = (m.versions.get("glpath", "absent") for m in (film.metadata, metadata))
    if before != now:
        found.append(("version of glpath", before, now))
    start, stop = path_sets
    if film.ranges and not (start <= film.ranges[0][0] and film.ranges[-1][1] <= stop):
        held = ", ".join(f"{a}:{b}" for a, b in film.ranges)
        found.append(("range of path sets", held, f"{start}:{stop}"))
    if found:
        raise AnotherRenderError(
            "; ".join(f"{what} is {theirs} in it, {ours} is asked for" for what, theirs, ours in found)
        )
    kinds: dict[str, tuple[object, object]] = {
        "device": (film.metadata.device, metadata.device),
        "versions": (film.metadata.versions, metadata.versions),
    }
    for what, (inside, here) in kinds.items():
        if film.path_sets and inside != here:
            log.info(
                "resuming with another %s: %s in the film, %s here; its bits are not those of one machine",
                what,
                shown(inside),
                shown(here),
            )

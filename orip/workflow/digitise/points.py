"""`orip digitise points`: photo points, driven to and digitised in one photo or stereoscopically in two."""

from __future__ import annotations

from collections.abc import Sequence

from orip.errors import ProjectWarning, UsageError
from orip.multimodel.digitising import Turn, from_point
from orip.workflow.digitise.point_visits import PointVisits, Viewing, Written
from orip.workflow.digitise.setup import Digitised, DigitisingSetup
from orip.workflow.digitise.wanted import BundlePoints, PointChoice, bundle_points, wanted_points


def digitise_points(
    setup: DigitisingSetup,
    bundle: str | None,
    choice: PointChoice,
    *,
    viewing: Viewing | None = None,
    start: str | None = None,
    written: Written | None = None,
) -> Digitised:
    """Digitise photo points of a bundle.

    New points are visited model by model (with one eye photo by photo), those of a list too; with `choice.again` point
    by point. See `orip.multimodel.digitising` for stereo partners and the transfer of points.

    Parameters
    ----------
    setup : DigitisingSetup
    bundle : str or None
        None: the project's only one.
    choice : PointChoice
    viewing : {"mono", "stereo"} or None
        None: stereo where the bundle has models.
    start : str or None
        The point to begin with.
    written : function or None
        Is told of each point that has been written to the log.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films("solutions")
    points = bundle_points(films, bundle)
    wanted = wanted_points(points, choice)
    for photo in {photo for photos in wanted.values() for photo in photos}:
        films.stage_of(points.films.definitions.photos[photo].name)
    viewing = viewing or ("stereo" if points.block.models else "mono")
    turns = _turns(points, wanted, viewing, again=choice.again)
    if start is not None:
        turns = _from(turns, start)
    repeat = "repeat the command, with --from POINT" if choice.again or choice.file else "repeat the command"
    with setup.session(films, f"all of it is in {films.shown_log}; {repeat}") as session:
        visits = PointVisits(session, points, viewing, again=choice.again, written=written)
        if not turns:
            session.warnings.append(_nothing_to_digitise(points))
        for turn in turns:
            visits.take(turn)
            if session.ending != "complete":
                break
    return setup.outcome(films, session)


def _turns(points: BundlePoints, wanted: dict[str, list[str]], viewing: Viewing, *, again: bool) -> list[Turn]:
    block = points.block
    if again:
        return list(block.turns_by_point(wanted))
    if viewing == "mono":
        return list(block.turns_by_photo(wanted))
    elsewhere = {
        point: [photo for photo in photos if photo not in wanted.get(point, ())]
        for point, photos in points.measured_photos.items()
    }
    return list(block.turns_by_model(wanted, elsewhere))


def _from(turns: Sequence[Turn], start: str) -> list[Turn]:
    rest = from_point(turns, start)
    if rest is None:
        message = f"point {start} is not among those to digitise; see them with --dry-run"
        raise UsageError(message)
    return list(rest)


def _nothing_to_digitise(points: BundlePoints) -> ProjectWarning:
    text = (
        "nothing to digitise: what these photos should show by the last adjustment is measured in them; name other "
        "points with --point or --list, or measure again with --again"
    )
    return ProjectWarning("nothing-to-digitise", f"bundle {points.bundle.name}", text)

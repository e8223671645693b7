"""`orip digitise points --online`: what comes from the plate processor goes through a session, which answers it."""

from __future__ import annotations

from cli.test_digitise_commands import done, emulator, new_cliff

from orip.online.session import OnlineSession

POINTS = ("1101", "1102", "1103")


def test_points_of_the_plate_processor_are_answered_and_go_on_in_a_session(tmp_path):
    folder = new_cliff(tmp_path / "new")
    simulated = ["--simulate", "films/DAY1.MEA"]
    with emulator(folder) as url:
        link = ["--link", url, *simulated]
        done(folder, "digitise", "template", "LEFT", *link)
        done(folder, "digitise", "photo", "101", *link)
        named = [word for point in POINTS for word in ("--point", point)]
        said = done(folder, "digitise", "points", "--photo", "101", *named, "--online", *link)
    assert "the session can be watched at http://127.0.0.1:" in said.err
    assert said.err.count("photo 101 waits: no two photos have 5 common points") == len(POINTS)
    measuring = OnlineSession(folder, None).measuring
    assert {measuring.answer("101", point).state for point in POINTS} == {"waiting"}
    assert len(measuring.block.measurements) == len(POINTS)

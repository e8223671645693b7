"""The screen of a session of digitising: its seven areas, what goes where, and where the plates are meanwhile."""

from __future__ import annotations

import re

from orip.errors import LinkError
from orip.multimodel.digitising.operator import AtTheProcessor, Sought, Visit
from orip.multimodel.digitising.screen import WIDTH, Screen, Shown, screen_lines
from orip.multimodel.state import Event, Status

STATUS = Status("1-2", "BOTH", "IN", "LEFT", (90, 90), False)
PLATES = ((1.25, -2.5), (100.0, 0.0))


class Processor:
    """A plate processor whose operator presses the foot switch at the third question."""

    def __init__(self, *, is_lost: bool = False) -> None:
        self.asked, self.is_lost = 0, is_lost

    def next_event(self):
        self.asked += 1
        return Event("RIGHT", plates=PLATES) if self.asked > 2 else None

    def status(self):
        if self.is_lost:
            message = "no link"
            raise LinkError(message)
        return STATUS

    def plates(self):
        return PLATES


def drawn(texts: list[str]) -> list[str]:
    return re.sub(r"\x1b\[[0-9]*[A-Z]", "", texts[-1]).split("\n")


def test_the_seven_areas_have_their_places():
    lines = screen_lines(
        Shown(
            "CLIFF", "digitise", [("RFS", "digitise"), ("ENTER", "keep")], STATUS, PLATES,
            [f"figure {number}" for number in range(9)], [f"digitised  point {number}" for number in range(20)],
            "at point 7 in 101",
        )
    )  # fmt: skip
    assert len(lines) == 23  # and one for what is typed
    assert max(map(len, lines)) <= WIDTH
    assert (lines[0][:4], lines[0][-5:]) == ("ORIP", "CLIFF")
    assert lines[2].split() == ["RFS", "digitise", "ENTER", "keep"]
    assert lines[6].split()[:6] == ["upper", "1.2500", "-2.5000", "lower", "100.0000", "0.0000"]
    assert "model 1-2" in lines[7]
    assert "prisms 90 90" in lines[7]
    assert lines[9:13] == [f"figure {number}" for number in range(5, 9)]
    assert lines[13].startswith("outcome")
    assert lines[14:-1] == [f"digitised  point {number}" for number in range(12, 20)]
    assert lines[-1] == "> at point 7 in 101"


def test_what_is_said_goes_to_its_area_and_the_plates_are_shown_while_waiting():
    texts: list[str] = []
    screen = Screen("digitise", texts.append)
    screen.project = "CLIFF"
    screen.tell("digitised  tick 1 of LEFT    1.0000 2.0000")
    screen.tell("  x0 0.1 y0 0.2")
    screen.tell("at tick 2 of LEFT (predicted)")
    visit = Visit((Sought("TICK", "LEFT", "2", "UPPER"),), "FOOT LEFT")
    event = AtTheProcessor(screen.waiting, None, screen.look).act(Processor(), visit)
    assert event.kind == "RIGHT"
    lines = drawn(texts)
    assert lines[2].split()[:6] == ["RFS", "digitise", "LFS", "skip", "ENTER", "keep"]
    assert "upper" in lines[6]
    assert lines[9] == "x0 0.1 y0 0.2"
    assert "digitised  tick 1 of LEFT    1.0000 2.0000" in lines[14:]
    assert "> at tick 2 of LEFT (predicted)" in lines
    assert texts[0].startswith("\x1b[2J")
    assert not any(text.startswith("\x1b[2J") for text in texts[1:])


def test_a_lost_link_is_left_to_whoever_waits():
    screen = Screen("digitise", lambda _: None)
    assert AtTheProcessor(screen.waiting, None, screen.look).act(Processor(is_lost=True), Visit((), "FOOT LEFT"))


def test_keys_follow_what_is_done():
    texts: list[str] = []
    screen = Screen("digitise", texts.append)
    screen.waiting(Visit((), "KEY ENTER", is_new=True, locks=True))
    assert "lock, unlock" in drawn(texts)[2]
    assert "next model" in drawn(texts)[2]
    screen.waiting(Visit((), "FOOT LEFT", hint="features"))
    assert "take back" in "".join(drawn(texts)[2:6])

"""How fast `orip screen` shows photos of 24 megapixels, and how much memory its server takes.

    PYTHONPATH=tests:benchmarks python benchmarks/screen_in_browser.py [PHOTOS]

Needs Chromium and its driver, and `pip install 'orip[browser,images]'`. Photos of the sample project drone_rtk, 60 at
most, become images of 6000 x 4000 pixels with colours and details at all scales. Measured are

- the first picture, from the page's address being opened until it is drawn: as a whole, then with all its tiles, with
  nothing kept on the disk and with tiles of before. On a machine that does other things besides, the processor's time
  of the server tells more;
- frames while the mouse drags the photo at full resolution: from the browser's trace, how long each thread works for a
  frame. At 60 frames a second none may take more than 16.7 ms;
- the server's largest memory, after all photos were looked at in full resolution and points were matched in all.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from browser.chromium import chromium
from PIL import Image
from screen.rendered_project import asked

SAMPLE = Path(__file__).parents[1] / "sample_projects" / "drone_rtk"
SIZE = (6000, 4000)
IMAGES = 2
"""Different ones: decoding takes as long of one as of the others."""
STEPS = 240
FRAME_MS = 1000.0 / 60.0
_ALL_DRAWN = "scene && !frames && tiles.size && [...tiles.values()].every(one => one.bitmap)"
_WHEN = """const done = arguments[1], holds = new Function(`return ${arguments[0]}`);
(function look() { if (holds()) done(performance.now()); else requestAnimationFrame(look); })()"""
_TIMELINE = "devtools.timeline"
_THREADS = {"CrRendererMain": "page", "Compositor": "compositor", "VizCompositorThread": "display"}


def picture(random: np.random.Generator) -> Image.Image:
    """Return an image with colours and details at all scales."""
    total = np.full((SIZE[1], SIZE[0], 3), 110.0, dtype=np.float32)
    for octave in range(9):
        cells = (SIZE[0] >> octave, SIZE[1] >> octave)
        noise = random.normal(0.0, 6.0 + 2.0 * octave, (cells[1], cells[0])).astype(np.float32)
        layer = np.asarray(Image.fromarray(noise).resize(SIZE, Image.Resampling.BICUBIC))
        total += layer[..., None] * random.uniform(0.5, 1.0, 3).astype(np.float32)
    return Image.fromarray(np.clip(total, 0, 255).astype(np.uint8))


def make_project(folder: Path, photos: int) -> None:
    """Write the project with pixels of its images, adjust it, and write the images."""
    shutil.copytree(SAMPLE, folder)
    toml = (folder / "orip.toml").read_text()
    columns, rows = map(int, re.search(r"columns = (\d+), rows = (\d+)", toml).groups())  # type: ignore[union-attr]
    (folder / "orip.toml").write_text(
        toml.replace(f"columns = {columns}, rows = {rows}", f"columns = {SIZE[0]}, rows = {SIZE[1]}")
    )
    log = [line.split() for line in (folder / "DRONE.MEA").read_text().splitlines()]
    (folder / "DRONE.MEA").write_text(
        "".join(
            f"{words[0]} {float(words[1]) * SIZE[0] / columns:.3f} {float(words[2]) * SIZE[1] / rows:.3f}\n"
            if len(words) == 3 and words[0] != "POINTS"
            else " ".join(words) + "\n"
            for words in log
        )
    )
    subprocess.run([sys.executable, "-m", "orip", "-C", folder, "run", "--no-report"], check=True, capture_output=True)
    random = np.random.default_rng(3)
    (folder / "images").mkdir()
    names = re.findall(r'name = "(DJI_\d+)"', toml)[:photos]
    for number, name in enumerate(names):
        path = folder / "images" / f"{name}.jpg"
        if number < IMAGES:
            picture(random).save(path, quality=92)
        else:
            os.link(folder / "images" / f"{names[number % IMAGES]}.jpg", path)


@contextmanager
def screen(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `orip screen`; give its process and the address of its page."""
    words = [sys.executable, "-m", "orip", "-C", str(folder), "screen", "--no-open", "--images", "images"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def cpu(process: subprocess.Popen[str]) -> float:
    """Return the CPU seconds of a process, user and system."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def largest_mb(process: subprocess.Popen[str]) -> int:
    """Return the largest memory of a process, 10^6 bytes."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) * 1024 // 1_000_000  # type: ignore[index]


def first_picture(browser: Any, folder: Path, kept: str) -> None:
    """Print when the page shows its photo."""
    with screen(folder) as (process, url):
        before = cpu(process)
        browser.get(url)
        first = browser.execute_async_script(_WHEN, "scene && [...tiles.values()].some(one => one.bitmap) && !frames")
        whole = browser.execute_async_script(_WHEN, _ALL_DRAWN)
        print(
            f"first picture, {kept}: drawn after {first / 1000:.2f} s, all tiles after {whole / 1000:.2f} s; "
            f"{cpu(process) - before:.2f} CPU s of the server"
        )


def panned(browser: Any) -> list[dict[str, Any]]:
    """Drag the photo at full resolution, and return the events of the browser's trace."""
    browser.execute_script("view.scale = 1; draw()")
    box = browser.find_element("id", "plate").rect
    x, y = box["x"] + box["width"] * 0.8, box["y"] + box["height"] * 0.8

    def mouse(kind: str, along: float) -> None:
        place = {"x": x - along, "y": y - 0.6 * along, "button": "left", "buttons": 1, "clickCount": 1}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": kind, **place})

    browser.execute_script("performance.mark('begin')")
    mouse("mousePressed", 0)
    for step in range(STEPS):  # there, while tiles come, and back
        mouse("mouseMoved", 5.0 * min(step, STEPS - step))
    mouse("mouseReleased", 0)
    browser.execute_script("performance.mark('end')")
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    return [one["params"] for one in messages if one["method"] == "Tracing.dataCollected"]


def told_of_frames(events: list[dict[str, Any]]) -> None:
    """Print how long the threads work for a frame, by their own times, and how many frames there were."""
    marks = {one["name"]: one["ts"] for one in events if one["name"] in {"begin", "end"}}
    dragged = [one for one in events if marks["begin"] <= one.get("ts", 0) <= marks["end"] and one.get("ph") == "X"]
    names = {
        (one["pid"], one["tid"]): one["args"]["name"] for one in events if one["name"] == "thread_name"
    }  # fmt: skip
    begins = np.array(sorted(one["ts"] for one in dragged if one["name"] == "FireAnimationFrame"))
    work: dict[tuple[int, int], Any] = defaultdict(lambda: np.zeros(len(begins) + 1))
    for one in dragged:
        if one["name"] == "RunTask":
            frame = int(np.searchsorted(begins, one["ts"] + one["dur"]))
            work[one["pid"], one["tid"]][frame] += one.get("tdur", 0) / 1000.0
    seconds = (marks["end"] - marks["begin"]) / 1e6
    print(f"{len(begins)} frames while dragging, {len(begins) / seconds:.0f} a second, {STEPS} movements of the mouse")
    for thread, title in _THREADS.items():
        found = max((each for key, each in work.items() if names.get(key) == thread), key=np.sum)
        middle, high, largest = np.percentile(found, [50, 95, 100])
        over = int((found > FRAME_MS).sum())
        print(
            f"  {title:<11} p50 {middle:5.2f}  p95 {high:5.2f}  max {largest:5.2f} ms of CPU a frame; {over} over 16.7"
        )


def looked_at(url: str, photos: int) -> None:
    """Ask for tiles of all photos in full resolution, and match a point in each."""
    for number in range(photos):
        for name in ("0/0/3", "0/5/3", "0/11/3", "2/0/0"):
            assert asked(url, f"pictures/{number}/{name}")[0] == 200
    for one in asked(url, "scene")[1]["photos"][:photos]:
        asked(url, "propose", {"photo": one["name"], "point": "110", "x": 3000.0, "y": 2000.0})


def main(photos: int) -> None:
    """Measure all."""
    options, trace = "--disable-gpu --window-size=1280,900", f"{_TIMELINE},disabled-by-default-{_TIMELINE}"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "project"
        make_project(folder, photos)
        with chromium(Path(temporary) / "first", options) as browser:
            for kept in ("nothing kept", "tiles of before"):
                first_picture(browser, folder, kept)
        with screen(folder) as (process, url):
            with chromium(
                Path(temporary) / "pan", options, "performance", trace=f"{trace},blink.user_timing"
            ) as browser:
                browser.get(url)
                browser.execute_async_script(_WHEN, _ALL_DRAWN)
                told_of_frames(panned(browser))
            looked_at(url, photos)
            print(f"largest memory of the server: {largest_mb(process)} MB, {photos} photos; {cpu(process):.1f} CPU s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)

"""What a solution shows in a notebook: tables, figures, reports; and models of other programs opened by one call."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from api.test_solution import solution
from exchange.colmap_samples import small_model, written

import orip

FIGURES = ("residuals", "plan", "block", "distortion", "normalised_residuals", "convergence")


@pytest.mark.parametrize("name", FIGURES)
def test_figures_can_be_shown(name: str) -> None:
    figure = getattr(solution().plot, name)()
    assert len(figure.data) > 0
    assert figure.to_dict()["layout"]["title"]["text"]
    assert "<div" in figure.to_html(include_plotlyjs=False)


def test_residual_vectors_have_the_length_of_the_residuals() -> None:
    found = solution()
    figure = found.plot.residuals("p2")
    (note,) = figure.layout.annotations
    scale = float(note.text.split()[2])
    lines = next(trace for trace in figure.data if trace.mode == "lines")
    ends = np.stack([lines.x, lines.y], axis=1).reshape(-1, 3, 2)
    residuals = found.residuals
    mine = (residuals.kind == "photo") & (residuals.photo == "P2") & (residuals.weight_factor == 1.0)
    wanted = residuals.residual[mine].reshape(-1, 2)
    assert ends[:, 1] - ends[:, 0] == pytest.approx(scale * wanted, abs=1e-9)
    assert figure.layout.title.text == "Residuals of photo P2"
    with pytest.raises(orip.UnknownNameError, match="there is no photo 'P99'"):
        found.plot.residuals("P99")
    with pytest.raises(orip.UnknownNameError, match="there is no camera 'X'"):
        found.plot.distortion("X")


def test_parameters_of_cameras_are_attributes() -> None:
    camera = solution().cameras["CAM"]
    assert camera.c == camera["C"] == camera.parameters[0]
    assert camera.sd.c == camera.sd["C"] == camera.deviations[0]
    assert {"c", "dx", "a3"} <= set(dir(camera)) & set(dir(camera.sd))
    assert repr(camera.sd).startswith("<sd: C ")
    with pytest.raises(AttributeError, match="has no attribute 'q9'"):
        _ = camera.q9
    with pytest.raises(orip.UnknownNameError, match="there is no parameter 'Q9'"):
        _ = camera.sd["Q9"]


def test_control_points_as_a_data_frame_are_the_residuals() -> None:
    found = solution()
    frame = found.to_dataframe("control")
    residuals = found.residuals
    for name, row in frame.iterrows():
        mine = (residuals.kind == "control") & (residuals.point == name)
        assert [row.dX, row.dY, row.dZ] == residuals.residual[mine].tolist()
        assert [row.wX, row.wY, row.wZ] == residuals.w[mine].tolist()
        assert [row.sX, row.sY, row.sZ] == found.points[str(name)].deviations.tolist()
    assert frame.attrs["units"]["dX"] == "m"
    assert frame.attrs["units"]["image"] == "mm"
    assert len(found.to_dataframe("check")) == len(found.check_points)
    assert found.to_dataframe("iterations").sigma0.iloc[-1] == pytest.approx(found.sigma0)
    assert list(found.to_dataframe("blunders").columns)[:3] == ["order", "kind", "photo"]
    assert len(found.to_dataframe("groups")) > 0


def test_a_notebook_shows_tables() -> None:
    found = solution()
    for shown in (found, found.points, found.photos, found.cameras, found.residuals, found.cameras["CAM"]):
        html = shown._repr_html_()
        assert html.count("<table") == html.count("</table>") >= 1
    assert "Control points (m" in found._repr_html_()
    assert f"{len(found.residuals) - 20} more rows" in found.residuals._repr_html_()
    assert f"{found.points['105'].coordinates[0]:.4f}" in found.points._repr_html_()


def test_reports_replace_reports_alone(tmp_path: Path) -> None:
    found = solution()
    page = tmp_path / "report.html"
    assert found.report(page) == page
    assert "How good is it?" in page.read_text(encoding="utf-8")
    found.report(page, "client")
    assert "What was done" in page.read_text(encoding="utf-8")
    found.report(tmp_path / "certificate.html", "certificate")
    (tmp_path / "letter.html").write_text("<html>Dear client")
    with pytest.raises(orip.UsageError, match="is no report of orip; name another file"):
        found.report(tmp_path / "letter.html")
    with pytest.raises(orip.UsageError, match="there is no report 'long'; there are: full, client, certificate"):
        found.report(page, "long")  # type: ignore[arg-type]


def test_a_model_of_colmap_becomes_a_plot_in_four_lines(tmp_path: Path) -> None:
    model = written(tmp_path / "model", small_model(), "txt")
    program = (
        "import sys, orip\n"
        f"project = orip.import_project({str(model)!r}, {str(tmp_path / 'block')!r})\n"
        "solution = project.solve()\n"
        "figure = solution.plot.residuals()\n"
        "print(solution.status, len(figure.data))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] in {"converged", "doubtful"}
    with pytest.raises(orip.UsageError, match="has something in it"):
        orip.import_project(model, tmp_path / "block")
    with pytest.raises(orip.UsageError, match=r"precision is 0\.0; it is in pixels, 0\.0001 to 100000"):
        orip.import_project(model, tmp_path / "other", precision=0.0)


def test_importing_the_api_loads_no_annex_and_no_plotly() -> None:
    program = (
        "import sys, orip.api\n"
        "print(sorted(name for name in sys.modules if name.startswith(('orip.exchange', 'plotly', 'jinja2'))))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"

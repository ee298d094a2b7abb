"""`orbitd plot` writes figures that show something, and refuses plainly."""

import sys

import pytest

from sim_hil import plots

FAST = ("orbit", "pressure", "campbell")


def colours(path):
    from matplotlib.image import imread

    image = imread(path)
    return image.shape, len(set(map(tuple, image[::5, ::5, :3].reshape(-1, 3).tolist())))


@pytest.mark.parametrize("kind", FAST)
def test_a_figure_is_drawn(kind, tmp_path, capsys):
    output = tmp_path / f"{kind}.png"
    assert plots.main([kind, "-o", str(output)]) == 0
    (height, width, _), used = colours(output)
    assert height > 500
    assert width > 1000
    assert used > 20
    assert capsys.readouterr().out.strip() == str(output)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(set(plots.KINDS) - set(FAST)))
def test_a_longer_figure_is_drawn(kind, tmp_path, monkeypatch):
    from sim_hil.plots import fields

    monkeypatch.setattr(fields, "_MAP_SPEEDS", 4)
    monkeypatch.setattr(fields, "_MAP_CLEARANCES", 4)
    output = tmp_path / f"{kind}.png"
    assert plots.main([kind, "-o", str(output)]) == 0
    assert colours(output)[1] > 20


def test_svg_holds_its_labels_as_drawn(tmp_path):
    output = tmp_path / "pressure.svg"
    assert plots.main(["pressure", "-o", str(output), "--rpm", "3000", "--load", "300"]) == 0
    assert output.read_text().lstrip().startswith("<?xml")


@pytest.mark.parametrize("name", ["orbit.jpg", "orbit"])
def test_other_files_are_refused(name, tmp_path):
    with pytest.raises(plots.PlotError, match=r"\.png or \.svg"):
        plots.main(["orbit", "-o", str(tmp_path / name)])


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(plots.PlotError, match="cannot be written there"):
        plots.main(["pressure", "-o", str(tmp_path / "none" / "p.png")])


def test_an_orbit_without_turns_is_refused(tmp_path):
    with pytest.raises(plots.PlotError, match="give a speed"):
        plots.main(["orbit", "-o", str(tmp_path / "o.png"), "--rpm", "0"])


def test_an_instability_is_named(tmp_path):
    output = tmp_path / "campbell.svg"
    assert plots.main(["campbell", "-o", str(output), "--load", "30"]) == 0
    assert "unstable" in output.read_text()


def test_absent_matplotlib_names_the_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(plots.PlotError, match="train"):
        plots.main(["orbit", "-o", str(tmp_path / "o.png")])

"""The channel map: which column is what, in which unit, at which rate, and where the shaft is."""

import numpy as np
import pytest

from models.readers.assemble import assemble
from models.readers.channel_map import FileMap, find, read_map
from models.readers.signal_file import Channel, SignalFile, SignalFileError

RATE, N = 2000.0, 4000
TIME = np.arange(N) / RATE
WAVE = np.sin(2.0 * np.pi * 25.0 * TIME)


def planned(path, text):
    (path / "channels.toml").write_text(text)
    return read_map(path / "channels.toml")


def made(path, *channels, **facts):
    return SignalFile(path / "a.csv", channels, facts)


def test_scale_offset_polarity_and_unit(tmp_path):
    text = """
        [[channel]]
        column = "ai0"
        name = "acc_motor"
        unit = "g"
        scale = 10.0
        offset = 0.5
        polarity = -1
    """
    file = made(tmp_path, Channel("AI0", WAVE, "V", RATE), Channel("AI1", WAVE, "V", RATE))
    found = assemble(file, planned(tmp_path, text))
    assert found.names == ("acc_motor",)
    assert found.units == ("m/s2",)
    assert np.allclose(found.values[:, 0], -(WAVE * 10.0 + 0.5) * 9.80665)


def test_pulses_of_a_mark_give_the_angle(tmp_path):
    turns = 10.0 * TIME + 5.0 * TIME**2
    pulse = np.where(turns % 1.0 < 0.1, 4.0, 0.1) + 0.05 * np.random.default_rng(0).normal(size=N)
    file = made(tmp_path, Channel("x", WAVE, "um", RATE), Channel("tacho", pulse, "V", RATE))
    found = assemble(file, planned(tmp_path, "[mark]\ncolumn = 'tacho'"))
    assert found.names == ("x",)
    off = (found.turns - turns)[200:-200]
    assert np.ptp(off) < 0.03, "one sample is 0.01 of a turn here"
    assert off.mean() == pytest.approx(round(off.mean()), abs=0.02)
    falling = planned(tmp_path, "[mark]\ncolumn = 'tacho'\nedge = 'falling'\nper_turn = 2")
    half = assemble(file, falling).turns
    assert np.diff(half)[1000:3000].mean() == pytest.approx(
        0.5 * np.diff(turns)[1000:3000].mean(), rel=0.02
    )


def test_a_column_of_speed_gives_the_angle(tmp_path):
    file = made(
        tmp_path,
        Channel("x", WAVE, "um", RATE),
        Channel("n", np.linspace(600.0, 1200.0, 101), "1/min", 50.0),
    )
    found = assemble(file, planned(tmp_path, "[speed]\ncolumn = 'n'"))
    assert found.turns[-1] == pytest.approx(30.0, rel=0.01)
    assert assemble(made(tmp_path, Channel("x", WAVE, "um", RATE)), FileMap()).turns is None
    constant = planned(tmp_path, "[speed]\nrpm = 3000")
    assert assemble(made(tmp_path, Channel("x", WAVE, "um", RATE)), constant).turns[-1] == (
        pytest.approx(50.0 * TIME[-1])
    )


def test_several_rates_are_refused_or_brought_to_one(tmp_path):
    half = np.arange(N // 2) / (RATE / 2)
    file = made(
        tmp_path,
        Channel("a", WAVE, "", RATE),
        Channel("b", np.sin(2.0 * np.pi * 25.0 * half), "", RATE / 2),
    )
    with pytest.raises(SignalFileError, match=r"several rates \(a 2000 Hz, b 1000 Hz\).*= 1000"):
        assemble(file, FileMap())
    found = assemble(file, planned(tmp_path, "[file]\nresample_hz = 1000"))
    assert found.rate_hz == 1000.0
    assert np.abs(found.values[100:-100, 0] - found.values[100:-100, 1]).max() < 1e-3
    with pytest.raises(SignalFileError, match=r"sampled at 1000 Hz, resample_hz asks for 2000"):
        assemble(file, planned(tmp_path, "[file]\nresample_hz = 2000"))


def test_what_lies_above_the_new_nyquist_frequency_is_cut(tmp_path):
    file = made(tmp_path, Channel("a", np.sin(2 * np.pi * 900.0 * TIME) + 0.01 * WAVE, "", RATE))
    found = assemble(file, planned(tmp_path, "[file]\nresample_hz = 500"))
    assert np.abs(found.values[50:-50]).max() < 0.02


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[file\n", r"channels.toml: .*line 1"),
        ("[file]\nrate = 5", r"unknown field `rate` - at `\$.file`; known keys are file: rate_hz,"),
        ("[file]\nrate_hz = -5", r"> 0.0 - at `\$.file.rate_hz`"),
        ("[[channel]]\ncolumn='b'\npolarity=2", r"polarity"),
        (
            "[[channel]]\ncolumn='b'",
            r"channel\]\] 1 in channels.toml: no column 'b', there are 'acc",
        ),
        ("[[channel]]\ncolumn='acx'", r"no column 'acx', .*did you mean 'acc'\?"),
        ("[[channel]]\ncolumn=3", r"column 3 of 2 \('acc', 'n'\)"),
        ("[[channel]]\ncolumn='n'\n[[channel]]\ncolumn='n'", r"two channels are named 'n'"),
        ("[speed]\ncolumn='n'\nunit='g'", r"a.csv: n: unit 'g' is no speed; give rpm, Hz or rad/s"),
        ("[mark]\ncolumn='n'\nlevel=9e9", r"a.csv: n: 0 marks in 2 s, at least 3 are needed; give"),
        ("[time]\ncolumn='when'", r"\[time\] in channels.toml: no column 'when'"),
    ],
)
def test_what_is_wrong_with_a_map_is_named(tmp_path, text, match):
    file = made(tmp_path, Channel("acc", WAVE, "", RATE), Channel("n", WAVE + 5.0, "", RATE))
    with pytest.raises(SignalFileError, match=match):
        assemble(file, planned(tmp_path, text))


def test_spans_and_their_refusal(tmp_path):
    file = made(tmp_path, Channel("acc", WAVE, "", RATE))
    assert np.array_equal(
        assemble(file, FileMap(), span_s=(0.5, 1.0)).values[:, 0], WAVE[1000:2000]
    )
    with pytest.raises(SignalFileError, match=r"from 0.5 s to 9 s of 2.000 s; correct start_s"):
        assemble(file, FileMap(), span_s=(0.5, 9.0))


def test_a_column_that_stands_twice_is_not_guessed():
    twice = [Channel("X", WAVE), Channel("x ", WAVE)]
    assert find(twice, "X", "here") == 0
    with pytest.raises(SignalFileError, match=r"here: 2 columns are named 'x'; give the number"):
        find(twice, "x", "here")

"""Text files as other people's systems write them."""

import numpy as np
import pytest

from models import readers
from models.readers.assemble import assemble
from models.readers.channel_map import FileMap, FileRules
from models.readers.signal_file import SignalFileError

N = 200
RNG = np.random.default_rng(0)
VALUES = np.round(RNG.normal(size=(N, 2)), 5)
TIME = np.arange(N) / 1000.0


def lines(cut, decimal=".", time=None):
    """Rows of time and two channels."""
    rows = []
    for t, row in zip(TIME if time is None else time, VALUES, strict=True):
        text = cut.join(
            [f"{t:.4f}" if isinstance(t, float) else str(t), *(f"{v:.5f}" for v in row)]
        )
        rows.append(text.replace(".", decimal))
    return rows


def read(path, text, encoding="utf-8", rules=None):
    path = path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return readers.read(path, rules or FileRules())


def samples(path, text, encoding="utf-8", plan=None):
    return assemble(read(path, text, encoding, plan.file if plan else None), plan or FileMap())


DIALECTS = {
    "comma": "t,x,y\n" + "\n".join(lines(",")),
    "semicolon and decimal comma": "T;X;Y\r\n" + "\r\n".join(lines(";", ",")),
    "tab": "time\tx\ty\n" + "\n".join(lines("\t")),
    "tab and decimal comma": "time\tx\ty\n" + "\n".join(lines("\t", ",")),
    "white space": "  time   x   y\n" + "\n".join("  " + line for line in lines("   ")),
    "bar": "t|x|y\n" + "\n".join(lines("|")),
    "no head": "\n".join(lines(",")),
    "no head, decimal comma": "\n".join(lines(";", ",")),
    "spaces about commas": "t , x , y\n" + "\n".join(lines(" , ")),
    "separator at the end": "t;x;y;\n" + "\n".join(line + ";" for line in lines(";")),
    "quotes": '"t","x","y"\n' + "\n".join(
        ",".join(f'"{f}"' for f in line.split(";")) for line in lines(";", ",")
    ),
    "head of several lines": (
        "Logger 4711\nOperator: B.\nSampling rate: 1,0 kHz\n\nTime;Ch 1;Ch 2\ns;m/s²;µm\n"
        + "\n".join(lines(";", ","))
    ),
    "remarks and a column that has no name": "t;x;y;remark;Comment\n" + "\n".join(
        f"{line};{'start' if k == 0 else 'ok'}" for k, line in enumerate(lines(";", ","))
    ),
    "numbered rows, a date and a time": "Nr;Datum;Uhrzeit;X;Y\n" + "\n".join(
        f"{k};01.02.2024;12:00:{line}" for k, line in
        enumerate(lines(";", ",", [f"{0.001 * k:06.3f}" for k in range(N)]))
    ),
    "an oscilloscope": "Model,DS1\nsecond,x,y\n" + "\n".join(
        lines(",", ".", [f"{t:e}" for t in TIME])
    ),
    "milliseconds since 1970": "timestamp,x,y\n" + "\n".join(
        lines(",", ".", [str(1700000000000 + k) for k in range(N)])
    ),
    "a date and time": "Datum;x;y\n" + "\n".join(
        lines(";", ".", [f"2024-05-01 23:59:59.{k:03d}" for k in range(N)])
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DIALECTS)
def test_every_dialect_gives_the_same_numbers(tmp_path, name):
    found = samples(tmp_path, DIALECTS[name])
    assert found.rate_hz == 1000.0
    if name == "head of several lines":
        assert found.names == ("Ch 1", "Ch 2")
        assert found.units == ("m/s2", "m")
        assert np.allclose(found.values, VALUES * [1.0, 1e-6])
        return
    assert np.array_equal(found.values, VALUES)
    assert [n.casefold() for n in found.names] == (
        ["column 2", "column 3"] if "no head" in name else ["x", "y"]
    )


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path, encoding):
    text = "Zeit [s];Weg (µm);y\n" + "\n".join(lines(";", ","))
    found = samples(tmp_path, text, encoding)
    assert found.names == ("Weg", "y")
    assert found.units == ("m", "")


def test_the_rate_of_a_head_and_of_milliseconds(tmp_path):
    head = "# Sampling frequency = 25.6 kHz\nx,y\n" + "\n".join(
        line.partition(",")[2] for line in lines(",")
    )
    assert samples(tmp_path, head).rate_hz == 25600.0
    text = "time_ms,x,y\n" + "\n".join(lines(",", ".", range(N)))
    assert samples(tmp_path, text).rate_hz == 1000.0


def test_coarse_stamps_give_their_mean_rate(tmp_path):
    stamps = [f"{0.01 * (k // 10):.2f}" for k in range(N)]
    text = "t,x,y\n" + "\n".join(lines(",", ".", stamps))
    assert samples(tmp_path, text).rate_hz == pytest.approx(1000.0, rel=0.06)


def changed(at, text):
    rows = lines(",")
    rows[at] = text
    return "t,x,y\n" + "\n".join(rows)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (changed(40, "0.0400,,1.0"), r"a.csv: line 42, x: missing or no number \(1 such values"),
        (changed(40, "0.0400,nan,1.0"), r"line 42, x: missing"),
        (changed(40, "0.0400,inf,1.0"), r"line 42, x: infinite"),
        (changed(40, "0.0400,overload,1.0"), r"line 42, x: 'overload' is no number; correct it"),
        (changed(N - 1, "0.1990,1.0"), r"line 201: 2 fields, the others have 3: .*complete the"),
        (changed(40, "0.9,1.0,1.0"), r"line 42: gap of 0.861 s after 0.039 s|line 43: time goes"),
        (
            "t,x,y\n" + "\n".join(lines(",")[:100] + lines(",", ".", TIME + 0.5)[100:]),
            r"a.csv: t: line 102: gap of 0.501 s after 0.099 s \(1 gaps in all\); cut",
        ),
        ("t,x,y\n" + "\n".join(lines(",")[50:] + lines(",")[:50]), r"line 152: time goes back"),
        ("t,x,y\n" + "\n".join(lines(",", ".", TIME**2)), r"a.csv: t: .*(gap|uneven steps)"),
        ("t,x,y\n" + "\n".join(lines(",", ".", 1e3 * TIME * 60)), r"0.01667 Hz .*is it ms\?"),
        ("x,y\n" + "\n".join(line.partition(",")[2] for line in lines(",")), r"no sampling rate"),
        ("one\ntwo\nthree\n", r"a.csv: line 2: no row of numbers: 'two'; give separator"),
        ("\n \n", r"no line holds anything"),
        ("\n".join(f"{k},{k % 7}" for k in range(N)), r"may be 2 numbers or 1 with decimal commas"),
        (
            "t;x\n" + "\n".join(f"{k};1.234,{k % 10}" for k in range(N)),
            r"line 2, x: '1.234,0' is no number; a separator of th",
        ),
        ("t;x\n" + "\n".join(f"{k};1.5" for k in range(N)), r"a.csv: x: never moves: the sensor"),
        ("t [s];x\n" + "\n".join(lines(";")), r"line 1: names 2 columns, the rows below have 3"),
        ("t [s];x [furlong];y\n" + "\n".join(lines(";")), r"x: unit 'furlong' is not known; give"),
        ("t;x;y\n" + "\n".join([*lines(";")[:-1], "0.199;1.234.567,0;1"]), r"line 201, x: .*thous"),
        (
            "t [s];x [m]\n" + "\n".join(f"{k};{k % 9}" for k in range(N)),
            r"x: rms .* m, more than a shaft displacement has .*is its unit mm or um or",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(tmp_path, text, match):
    with pytest.raises(SignalFileError, match=match):
        samples(tmp_path, text)


def test_what_is_ambiguous_can_be_said(tmp_path):
    text = "\n".join(f"{k},{k % 7}" for k in range(N))
    one = read(tmp_path, text, rules=FileRules(separator=" ", decimal=","))
    assert one.channels[0].values[8] == 8.1
    assert len(read(tmp_path, text, rules=FileRules(separator=",")).channels) == 2


def test_binary_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"RIFF\x00\x00" + bytes(100))
    with pytest.raises(SignalFileError, match="holds binary data, no text"):
        readers.read(tmp_path / "a.csv", FileRules())
    (tmp_path / "b.csv").write_bytes(b"")
    with pytest.raises(SignalFileError, match=r"b.csv: empty file"):
        readers.read(tmp_path / "b.csv", FileRules())
    with pytest.raises(SignalFileError, match=r"c.csv: no such file"):
        readers.read(tmp_path / "c.csv", FileRules())
    with pytest.raises(SignalFileError, match=r"no reader for '.xlsx'; save it as one of"):
        readers.read(tmp_path / "c.xlsx", FileRules())

"""Every format, written by its own library and read back."""

import sys

import numpy as np
import pytest

from models import readers
from models.diagnosis.dataset_folder import read_folder
from models.readers.assemble import assemble
from models.readers.channel_map import FileMap, FileRules
from models.readers.signal_file import SignalFileError

N, RATE = 512, 1000.0
VALUES = np.random.default_rng(0).normal(size=(N, 2))


def samples(path, **given):
    return assemble(readers.read(path, FileRules()), FileMap(), **given)


@pytest.mark.parametrize(
    ("dtype", "step"), [(np.uint8, 2**-7), (np.int16, 2**-15), (np.int32, 2**-31), (np.float32, 0)]
)
def test_wav(tmp_path, dtype, step):
    from scipy.io import wavfile

    unit = VALUES / np.abs(VALUES).max() * 0.99
    whole = np.round(unit / step) if step else unit
    wavfile.write(
        tmp_path / "a.wav", 1000, (whole + (128 if dtype == np.uint8 else 0)).astype(dtype)
    )
    found = samples(tmp_path / "a.wav")
    assert found.rate_hz == RATE
    assert found.names == ("channel 1", "channel 2")
    assert np.allclose(found.values, unit, atol=max(step, 1e-6))


def test_a_wav_that_is_cut_short_is_refused(tmp_path):
    from scipy.io import wavfile

    wavfile.write(tmp_path / "a.wav", 1000, VALUES.astype(np.float32))
    (tmp_path / "b.wav").write_bytes((tmp_path / "a.wav").read_bytes()[:-1000])
    with pytest.raises(SignalFileError, match=r"b.wav: (ends before the samples|not a WAV)"):
        samples(tmp_path / "b.wav")


def test_mat_and_its_scalars_and_structures(tmp_path):
    from scipy.io import savemat

    tree = {
        "X097_DE_time": VALUES[:, :1],
        "X097_FE_time": VALUES[:, 1:],
        "X097RPM": 1797.0,
        "fs": 1e3,
    }
    savemat(tmp_path / "a.mat", tree)
    found = samples(tmp_path / "a.mat")
    assert found.names == ("X097_DE_time", "X097_FE_time")
    assert np.array_equal(found.values, VALUES)
    assert found.rate_hz == RATE
    savemat(
        tmp_path / "b.mat", {"bearing": {"gs": VALUES.T, "sr": 1000, "rpm": 1500.0, "who": "x"}}
    )
    found = samples(tmp_path / "b.mat")
    assert found.names == ("bearing.gs 1", "bearing.gs 2")
    assert np.array_equal(found.values, VALUES)
    assert found.turns[-1] == pytest.approx((N - 1) / RATE * 25.0)
    assert found.notes == ("bearing.who: no numbers, left out",)


def test_mat_of_hdf5_and_a_damaged_one_are_refused(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    with pytest.raises(SignalFileError, match=r"save it with save\('a.mat', '-v7'\)"):
        samples(tmp_path / "a.mat")
    (tmp_path / "b.mat").write_bytes(b"nonsense" * 100)
    with pytest.raises(SignalFileError, match=r"b.mat: not a MATLAB file that can be read"):
        samples(tmp_path / "b.mat")


def test_numpy(tmp_path):
    np.savez(tmp_path / "a.npz", ax=VALUES[:, 0], ay=VALUES[:, 1], fs=1000)
    found = samples(tmp_path / "a.npz")
    assert (found.names, found.rate_hz) == (("ax", "ay"), RATE)
    np.save(tmp_path / "a.npy", VALUES)
    assert np.array_equal(samples(tmp_path / "a.npy", rate_hz=RATE).values, VALUES)
    np.savez(tmp_path / "b.npz", a=np.array([{}], dtype=object))
    with pytest.raises(SignalFileError, match=r"b.npz: not a NumPy archive"):
        samples(tmp_path / "b.npz")


def test_tdms(tmp_path):
    from nptdms import ChannelObject, RootObject, TdmsWriter

    with TdmsWriter(tmp_path / "a.tdms") as writer:
        about = {"wf_increment": 1e-3, "unit_string": "g"}
        writer.write_segment(
            [RootObject(), *(ChannelObject("Log", f"AI{i}", VALUES[:, i], about) for i in range(2)),
             ChannelObject("Log", "remark", ["started"])]
        )  # fmt: skip
    found = samples(tmp_path / "a.tdms")
    assert (found.names, found.rate_hz, found.units) == (("AI0", "AI1"), RATE, ("m/s2", "m/s2"))
    assert np.allclose(found.values, VALUES * 9.80665)
    assert found.notes == ("remark: no numbers, left out",)
    (tmp_path / "b.tdms").write_bytes(b"TDSm" + bytes(3))
    with pytest.raises(SignalFileError, match=r"b.tdms: (not a TDMS file|no channel of numbers)"):
        samples(tmp_path / "b.tdms")


def test_mdf4(tmp_path):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        stamps = np.arange(N) / RATE
        file.append([Signal(VALUES[:, i], stamps, name=f"acc{i}", unit="m/s^2") for i in range(2)])
        file.append([Signal(np.arange(8.0) ** 2, np.cumsum(np.arange(8.0)), name="event", unit="")])
        file.save(tmp_path / "a.mf4")
    file = readers.read(tmp_path / "a.mf4", FileRules())
    assert [c.name for c in file.channels] == ["acc0", "acc1", "event"]
    with pytest.raises(SignalFileError, match=r"a.mf4: event: .*(gap|uneven).*or choose other ch"):
        assemble(file, FileMap())
    rows = FileMap(channel=tuple(readers.channel_map.ChannelRow(f"acc{i}") for i in range(2)))
    found = assemble(file, rows)
    assert np.array_equal(found.values, VALUES)
    assert (found.rate_hz, found.units) == (RATE, ("m/s2", "m/s2"))


def test_uff58(tmp_path):
    import pyuff

    file = pyuff.UFF(str(tmp_path / "a.uff"))
    for i in range(2):
        file.write_sets(
            {
                "type": 58,
                "func_type": 1,
                "rsp_node": 1,
                "rsp_dir": 1,
                "ref_dir": 1,
                "ref_node": 1,
                "data": VALUES[:, i],
                "x": np.arange(N) / RATE,
                "id1": f"point {i}",
                "rsp_ent_name": "a",
                "ref_ent_name": "b",
                "abscissa_spacing": 1,
                "ordinate_axis_units_lab": "m/s2",
                "abscissa_spec_data_type": 17,
                "ordinate_spec_data_type": 12,
                "orddenom_spec_data_type": 0,
            },
            "add" if i else "overwrite",
        )
    found = samples(tmp_path / "a.uff")
    assert found.names == ("point 0", "point 1")
    assert found.rate_hz == pytest.approx(RATE)
    assert np.allclose(found.values, VALUES, rtol=1e-5)


def test_parquet_of_plain_columns(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = {"time": np.arange(N) / RATE, "ax": VALUES[:, 0], "ay": VALUES[:, 1], "who": ["x"] * N}
    pq.write_table(pa.table(table), tmp_path / "a.parquet")
    found = samples(tmp_path / "a.parquet")
    assert (found.names, found.rate_hz) == (("ax", "ay"), RATE)
    assert found.notes == ("who: no numbers, left out", "1000 Hz by the stamps of 'time'")


def bearing_dataset(folder, **changed):
    """A data set as bearing-datasets writes it: four recordings of two channels, in volts."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng = np.random.default_rng(3)
    (folder / "signals").mkdir(parents=True)
    rows, lists = [], []
    for r in range(4):
        for c in range(2):
            rows.append(
                {
                    "dataset": "mine",
                    "signal_id": f"r{r}/c{c}",
                    "recording_id": f"r{r}",
                    "native_label": "N",
                    "channel": f"c{c}",
                    "sensor_location": "base",
                    "fs": 1000.0,
                    "n_samples": N,
                    "fault_type": ("normal", "inner")[r % 2],
                    "fault_location": "none",
                    "sensor_at_fault": False,
                    "signal_file": "part-float32.parquet",
                    "signal_row_group": r // 2,
                    "signal_row": 2 * (r % 2) + c,
                    "unit": "V",
                    "sensitivity": "100 mV/g",
                    "speed_rpm": 1500.0,
                    "bearing_id": f"b{r // 2}",
                }
                | changed
            )
            lists.append(rng.normal(size=N).astype(np.float32))
    pq.write_table(pa.Table.from_pylist(rows), folder / "metadata.parquet")
    pq.write_table(
        pa.table({"signal_id": [r["signal_id"] for r in rows], "signal": lists}),
        folder / "signals" / "part-float32.parquet",
        row_group_size=4,
    )
    return np.array(lists)


def test_a_data_set_of_bearing_datasets(tmp_path):
    lists = bearing_dataset(tmp_path / "mine")
    found = read_folder(tmp_path / "mine")
    assert [(r.name, r.label, r.group, r.machine) for r in found] == [
        (f"r{r}", ("normal", "inner")[r % 2], f"b{r // 2}", "mine") for r in range(4)
    ]
    assert found[0].channels == ("c0", "c1")
    assert found[0].units == ("m/s2", "m/s2")
    assert np.allclose(found[3].samples, lists[6:].T * 98.0665, rtol=1e-6)
    assert found[0].turns[-1] == pytest.approx((N - 1) / RATE * 25.0)
    assert [r.group for r in read_folder(tmp_path / "mine", "recording_id")] == [
        "r0",
        "r1",
        "r2",
        "r3",
    ]
    with pytest.raises(ValueError, match=r"lacks the column session; it has dataset, signal_id"):
        read_folder(tmp_path / "mine", "session")


def test_a_data_set_that_points_beyond_its_files_is_refused(tmp_path):
    bearing_dataset(tmp_path / "mine", signal_row=9)
    with pytest.raises(ValueError, match=r"row group 0 has no row 9; build it again"):
        read_folder(tmp_path / "mine")


def flown(folder, gap_after=None):
    """A recording of blocks by the device's own recorder: 40 blocks of 50 instants at 5 kHz, a
    mark each 100."""
    import msgspec

    from firmware_py import config
    from firmware_py.gate.recorder import Recorder
    from firmware_py.records import Block

    settings, _ = config.load(config.SHIPPED / "bench")
    text = msgspec.json.encode(settings).decode()
    recorder = Recorder(
        folder, "t", {"config": text, "orbitd": "x"}, 10**8, lambda: 10**18, raw_frames=False
    )
    counts = np.random.default_rng(0).integers(-900, 900, (2000, 8)).astype("<i2")
    for seq in range(40):
        start = 50 * seq + (500 if gap_after is not None and seq > gap_after else 0)
        marks = [200 * start] if start % 100 == 0 else []
        block = Block(
            seq=seq, t_acq_ns=200_000 * start, period_ns=200_000, tick_us=200 * start,
            sample_period_us=200, quality=0, channel_ok=255, speed_rad_s=314.0, turn_count=seq // 2,
            mark_ticks_us=marks, samples=counts[50 * seq : 50 * seq + 50].tobytes(),
        )  # fmt: skip
        recorder.write(block, block.t_acq_ns)
    recorder.close()
    return next(folder.glob("*.mcap")), counts, settings.machine.channel


def test_our_own_recording_of_blocks(tmp_path):
    path, counts, rows = flown(tmp_path)
    found = samples(path)
    assert found.names == tuple(row.name for row in rows)
    assert found.units[:3] == ("m", "m", "m/s2")
    assert np.allclose(found.values, counts * [r.scale for r in rows] + [r.offset for r in rows])
    assert found.turns[1950] == pytest.approx(19.5)
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(SignalFileError, match=r"mcap: no MCAP file, or damaged"):
        samples(path)


def test_a_gap_in_our_own_recording_is_noted(tmp_path):
    path, *_ = flown(tmp_path, gap_after=9)
    found = samples(path)
    assert found.values.shape == (1500, 8)
    assert found.notes == (
        "2 stretches between gaps; used the longest, from 0.200 s for 0.300 s of 0.400 s",
    )


@pytest.mark.slow
def test_our_own_recording_of_raw_frames_is_replayed(tmp_path):
    import lzma
    from pathlib import Path

    golden = Path(__file__).parents[1] / "golden" / "monitor.mcap.xz"
    path = tmp_path / "monitor.mcap"
    path.write_bytes(lzma.decompress(golden.read_bytes()))
    found = samples(path)
    turns_s = np.diff(found.turns) * found.rate_hz
    assert found.rate_hz == 5000.0
    assert 10.0 < np.median(turns_s) < 300.0
    assert (turns_s > 0.0).all()


def test_an_absent_library_says_which_extra_brings_it(tmp_path, monkeypatch):
    (tmp_path / "a.tdms").write_bytes(b"TDSm")
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(SignalFileError, match=r"needs the library nptdms .*'orbitd\[export\]'"):
        samples(tmp_path / "a.tdms")

"""A recording is a LeRobot data set: files, columns and types as version 3.0 of its format has them.

The format: https://huggingface.co/docs/lerobot/lerobot-dataset-v3.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from PIL import Image

from robotree.tui.cli import main
from robotree.tui.recording.tape import TapeWriter
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.requests import LoggedLine, Picture, State

NOON = 1_800_000_000.0
ARM = RobotDescription(address=Address("robot", "arm-1", "1"), kinds=("Arm",), units={"z": "m"})


def jpeg(colour: tuple[int, int, int], size: tuple[int, int] = (32, 16)) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", size, colour).save(stream, "JPEG", quality=95)
    return stream.getvalue()


def written(
    file: Path, *, size: tuple[int, int] = (32, 16), readings: bool = True, caller: str = "anna@pts/3"
) -> Path:
    with file.open("wb") as stream:
        writer = TapeWriter(stream, {"realm": "hall", "began": repr(NOON)})
        writer.description(NOON, ARM)
        for tenth in range(60):
            given = {"z": tenth / 10, "x": 0.5, "age": 0.01} if readings else {}
            writer.state(NOON + tenth / 10, "arm-1", State(readings=given))
        writer.picture(NOON + 0.1, "cell", Picture(jpeg=jpeg((255, 0, 0)), width=32, height=16, camera="top"))
        writer.picture(
            NOON + 2,
            "cell",
            Picture(jpeg=jpeg((0, 0, 255), size), width=size[0], height=size[1], camera="top"),
        )
        for number, (begin, end, how) in enumerate(
            ((1.0, 2.0, "done"), (2.5, 3.0, "failed"), (3.0, 5.0, "done"))
        ):
            asked = {"command": "lift", "key": str(number), "caller": caller, "arguments": f"z={number}"}
            writer.line("arm-1", LoggedLine(number, NOON + begin, "asked", "", **asked))
            line = LoggedLine(number, NOON + end, how, "", command="lift", key=str(number))  # type: ignore[arg-type]
            writer.line("arm-1", line)
        writer.close()
    return file


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    assert main(["export", "lerobot", str(written(tmp_path / "a.mcap")), str(tmp_path / "set")]) == 0
    return tmp_path / "set"


def loaded(path: Path) -> Any:
    return json.loads(path.read_text())


def test_the_columns_have_the_types_of_the_features(dataset: Path) -> None:
    info = loaded(dataset / "meta" / "info.json")
    assert (info["codebase_version"], info["fps"], info["splits"]) == ("v3.0", 10, {"train": "0:2"})
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 30, 2)
    path = info["data_path"].format(chunk_index=0, file_index=0)
    schema = pq.read_table(dataset / path).schema
    assert schema.names == list(info["features"])
    types = {name: str(schema.field(name).type) for name in schema.names}
    assert types == {
        "observation.state": "fixed_size_list<element: float>[2]",
        "action": "fixed_size_list<element: float>[2]",
        "observation.images.cell_top": "struct<bytes: binary, path: string>",
        "timestamp": "float",
        **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64"),
    }
    assert info["features"]["observation.state"]["names"] == ["arm-1.x", "arm-1.z"]
    assert info["features"]["observation.images.cell_top"]["shape"] == [16, 32, 3]


def test_a_frame_is_how_it_was_then_and_the_action_how_it_was_next(dataset: Path) -> None:
    rows = pq.read_table(dataset / "data" / "chunk-000" / "file-000.parquet").to_pylist()
    assert [row["index"] for row in rows] == list(range(30))
    assert [row["frame_index"] for row in rows] == [*range(10), *range(20)]
    assert rows[3]["timestamp"] == pytest.approx(0.3)
    assert rows[3]["observation.state"] == pytest.approx([0.5, 1.3])
    assert rows[3]["action"] == pytest.approx([0.5, 1.4])
    assert rows[0]["observation.images.cell_top"]["bytes"] == jpeg((255, 0, 0))
    assert rows[10]["observation.images.cell_top"]["bytes"] == jpeg((0, 0, 255))


def test_each_command_that_was_done_is_an_episode_with_its_task(dataset: Path) -> None:
    episodes = pq.read_table(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    bounds = [(each["dataset_from_index"], each["dataset_to_index"], each["length"]) for each in episodes]
    assert bounds == [(0, 10, 10), (10, 30, 20)]
    assert [each["tasks"] for each in episodes] == [["arm-1.lift z=0"], ["arm-1.lift z=2"]]
    assert episodes[1]["stats/observation.state/max"] == pytest.approx([0.5, 4.9])
    tasks = pq.read_table(dataset / "meta" / "tasks.parquet")
    assert tasks.to_pylist() == [
        {"task_index": 0, "task": "arm-1.lift z=0"},
        {"task_index": 1, "task": "arm-1.lift z=2"},
    ]
    assert json.loads((tasks.schema.metadata or {})[b"pandas"])["index_columns"] == ["task"]


def test_the_statistics_are_those_of_the_frames(dataset: Path) -> None:
    stats = loaded(dataset / "meta" / "stats.json")
    rows = pq.read_table(dataset / "data" / "chunk-000" / "file-000.parquet").to_pylist()
    heights = [row["observation.state"][1] for row in rows]
    mean = sum(heights) / len(heights)
    deviation = (sum((each - mean) ** 2 for each in heights) / len(heights)) ** 0.5
    assert stats["observation.state"]["mean"][1] == pytest.approx(mean)
    assert stats["observation.state"]["std"][1] == pytest.approx(deviation)
    assert stats["observation.state"]["count"] == [30]
    red = [channel[0][0] for channel in stats["observation.images.cell_top"]["mean"]]
    assert red == pytest.approx([1 / 3, 0.0, 2 / 3], abs=0.02)
    assert stats["observation.images.cell_top"]["std"][0][0][0] == pytest.approx((2 / 9) ** 0.5, abs=0.02)


def test_several_files_hold_a_large_data_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotree.tui.recording.lerobot.FILE_SIZE", 0)
    assert main(["export", "lerobot", str(written(tmp_path / "a.mcap")), str(tmp_path / "set")]) == 0
    episodes = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [each["data/file_index"] for each in episodes] == [0, 1]
    second = pq.read_table(tmp_path / "set/data/chunk-000/file-001.parquet").to_pylist()
    assert {row["episode_index"] for row in second} == {1}


def test_what_makes_no_data_set_is_refused_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, options, reason in (
        ("sizes", {"size": (64, 32)}, "holds pictures of observation.images.cell_top in several sizes"),
        ("mute", {"readings": False}, "holds no readings"),
        ("robots", {"caller": "mover"}, "holds no command that a person asked for"),
    ):
        file = written(tmp_path / f"{name}.mcap", **options)  # type: ignore[arg-type]
        assert main(["export", "lerobot", str(file), str(tmp_path / "set")]) == 1
        assert reason in capsys.readouterr().err
        assert not (tmp_path / "set").exists()
    (tmp_path / "set").mkdir()
    assert main(["export", "lerobot", str(written(tmp_path / "b.mcap")), str(tmp_path / "set")]) == 1
    assert "it exists already" in capsys.readouterr().err
    assert main(["export", "lerobot", str(tmp_path / "b.mcap"), str(tmp_path / "c"), "--fps", "0"]) == 2

"""A recording as a LeRobot data set, version 3.0: `robotree export lerobot FILE`.

    meta/info.json, meta/stats.json                what is in it; least, largest, mean, deviation of each
    meta/tasks.parquet                             the commands, as tasks in words
    meta/episodes/chunk-000/file-000.parquet       one row for each episode
    data/chunk-000/file-000.parquet                one row for each frame, pictures in it as JPEG

Each command that a person asked for, and that was done, is an episode; its words are the task. A frame is
how everything was at that time: `observation.state` holds the readings of all robots, in SI units, as they
were heard last, and `observation.images.VIEW_CAMERA` the newest picture. `action` holds the same readings one
frame later: what was brought about.

Format: https://huggingface.co/docs/lerobot/lerobot-dataset-v3
"""

from __future__ import annotations

import io
import json
import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from robotree.tui.errors import BadRecordedRealm
from robotree.tui.line import values
from robotree.tui.recording import comparing
from robotree.tui.recording.tape import RecordedPicture, RecordedState, Tape

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = "v3.0"
FPS = 10
"""[1/s] of frames, when the line does not say."""

CHUNK = 1000
"""Files in one folder, at most."""

FILE_SIZE = 100
"""[MB] from which on the next episode begins another file."""

PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
WHITE = 255.0
"""The largest value of a channel."""

LEFT_OUT = frozenset({"age", "progress"})
"""Readings that say nothing of a robot itself."""

COUNTS = ("frame_index", "episode_index", "index", "task_index")


class Taken(NamedTuple):
    """What was read over the whole recording, each with its time."""

    names: tuple[str, ...]
    """`arm-1.x`, in the order of `observation.state`."""
    readings: Mapping[str, tuple[list[float], list[float]]]
    """Times [s since 1970] and values, by name."""
    cameras: Mapping[str, tuple[list[float], list[bytes]]]
    """Times and JPEGs, by feature."""
    sizes: Mapping[str, tuple[int, int]]
    """[px] height and width, by feature."""

    def state(self, unix: float) -> list[float]:
        """Return all readings at a moment, as they were heard last, or first if they came later."""
        return [_latest(*self.readings[name], unix) for name in self.names]

    def picture(self, feature: str, unix: float) -> bytes:
        """Return the newest picture of a camera at a moment."""
        picture: bytes = _latest(*self.cameras[feature], unix)
        return picture


def _latest(times: Sequence[float], values: Sequence[Any], unix: float) -> Any:
    return values[max(bisect_right(times, unix) - 1, 0)]


class Episode(NamedTuple):
    """One command that was done."""

    task: str
    times: tuple[float, ...]
    """[s since 1970] of its frames."""


def taken(tape: Tape) -> Taken:
    """Return what a recording holds for a data set.

    Raises:
        BadRecordedRealm: no robot said anything that can be read, or a camera changed its size.
    """
    readings, cameras = (
        dict[str, tuple[list[float], list[float]]](),
        dict[str, tuple[list[float], list[bytes]]](),
    )
    for unix, (name, state) in tape.all_of(RecordedState):
        for key, value in state.readings.items():
            if key not in LEFT_OUT:
                times, values = readings.setdefault(f"{name}.{key}", ([], []))
                times.append(unix)
                values.append(value)
    for unix, picture in tape.all_of(RecordedPicture):
        feature = f"observation.images.{picture.view}_{picture.camera}"
        times, pictures = cameras.setdefault(feature, ([], []))
        times.append(unix)
        pictures.append(picture.jpeg)
    if not readings:
        raise BadRecordedRealm(tape.name, "holds no readings, and a data set is made of these")
    sizes = {feature: _size(tape.name, feature, pictures) for feature, (_, pictures) in cameras.items()}
    return Taken(tuple(sorted(readings)), readings, cameras, sizes)


def _size(name: str, feature: str, pictures: Sequence[bytes]) -> tuple[int, int]:
    from PIL import Image

    found = set[tuple[int, int]]()
    for jpeg in pictures:
        try:
            with Image.open(io.BytesIO(jpeg), formats=["JPEG"]) as image:
                found.add((image.height, image.width))
        except OSError:
            raise BadRecordedRealm(name, f"holds a picture of {feature} that cannot be read") from None
    if len(found) > 1:
        raise BadRecordedRealm(name, f"holds pictures of {feature} in several sizes; record it again")
    return found.pop()


def episodes_of(tape: Tape, fps: int) -> list[Episode]:
    """Return the commands that persons asked for and that were done, with the times of their frames.

    Raises:
        BadRecordedRealm: there is none.
    """
    found = list[Episode]()
    for each in comparing.ran(tape, persons=True):
        if each.result == "done" and each.ended is not None:
            count = max(math.ceil((each.ended - each.began) * fps), 1) + 1
            times = tuple(tape.began + each.began + number / fps for number in range(count))
            found.append(Episode(each.words, times))
    if not found:
        raise BadRecordedRealm(tape.name, "holds no command that a person asked for and that was done")
    return found


def fps_of(text: str) -> int:
    """Read a number of frames a second.

    Raises:
        ValueRefused: it is none.
    """
    refusal = "is no number of frames a second, from 1 to 100"
    return values.whole("NUMBER", text, 1, 100, refusal) if text else FPS


def write(tape: Tape, folder: Path, fps: int) -> dict[str, Any]:
    """Write a recording as a data set into a new folder; returns how much is in it.

    Raises:
        BadRecordedRealm: it holds nothing for one.
        OSError: it cannot be written.
    """
    things, episodes = taken(tape), episodes_of(tape, fps)
    tasks = list(dict.fromkeys(each.task for each in episodes))
    folder.mkdir()
    writer = _Writer(folder, things, fps, tasks)
    for episode in episodes:
        writer.add(episode)
    writer.close()
    return {"episodes": len(episodes), "frames": writer.frames, "tasks": len(tasks)}


class _Statistics:
    """Least, largest, mean and deviation of vectors that come one after the other."""

    def __init__(self, width: int) -> None:
        self.count = 0
        self.least, self.most = [math.inf] * width, [-math.inf] * width
        self._mean, self._squares = [0.0] * width, [0.0] * width

    def add(self, vector: Sequence[float]) -> None:
        """Take one more."""
        self.add_many(vector, vector, vector, [0.0] * len(vector))

    def add_many(
        self,
        means: Sequence[float],
        least: Sequence[float],
        most: Sequence[float],
        variances: Sequence[float],
    ) -> None:
        """Take a portion of values, each time of the same size, such as the pixels of a picture (Welford)."""
        self.count += 1
        for position, value in enumerate(means):
            self.least[position] = min(self.least[position], least[position])
            self.most[position] = max(self.most[position], most[position])
            self._squares[position] += variances[position]
            off = value - self._mean[position]
            self._mean[position] += off / self.count
            self._squares[position] += off * (value - self._mean[position])

    def structure(self, *, deep: bool = False) -> dict[str, Any]:
        """Return all; `deep`: each value as [[value]], which is the form for the channels of pictures."""
        deviation = [math.sqrt(max(each, 0.0) / max(self.count, 1)) for each in self._squares]
        found = {"min": self.least, "max": self.most, "mean": self._mean, "std": deviation}
        shaped = {
            name: [[[value]] for value in values] if deep else list(values) for name, values in found.items()
        }
        return {**shaped, "count": [self.count]}


class _Writer:
    """Writes one data set."""

    def __init__(self, folder: Path, things: Taken, fps: int, tasks: Sequence[str]) -> None:
        self._folder, self._things, self._fps, self._tasks = folder, things, fps, list(tasks)
        self.frames = 0
        self._rows = list[dict[str, Any]]()
        """Of the episodes."""
        self._file, self._bytes = 0, 0
        self._data: Any = None
        self._whole = self._fresh()

    def _fresh(self) -> dict[str, _Statistics]:
        width = len(self._things.names)
        vectors = {name: _Statistics(width) for name in ("observation.state", "action")}
        scalars = {name: _Statistics(1) for name in ("timestamp", *COUNTS)}
        return {**vectors, **scalars, **{name: _Statistics(3) for name in self._things.cameras}}

    def add(self, episode: Episode) -> None:
        """Write one episode."""
        number, begin = len(self._rows), self.frames
        own, table = self._fresh(), self._table(episode, number)
        for row in table:
            for statistics in (own, self._whole):
                self._count(statistics, row)
        self._put(table)
        self.frames += len(table)
        stats = {
            f"stats/{name}/{kind}": value
            for name, each in own.items()
            for kind, value in each.structure(deep=name in self._things.cameras).items()
        }
        self._rows.append(
            {
                "episode_index": number,
                "tasks": [episode.task],
                "length": len(table),
                "data/chunk_index": self._file // CHUNK,
                "data/file_index": self._file % CHUNK,
                "dataset_from_index": begin,
                "dataset_to_index": self.frames,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **stats,
            }
        )

    def _table(self, episode: Episode, number: int) -> list[dict[str, Any]]:
        things, states = self._things, [self._things.state(unix) for unix in episode.times]
        rows = list[dict[str, Any]]()
        for frame, ((unix, state), (_, after)) in enumerate(
            pairwise(zip(episode.times, states, strict=True))
        ):
            pictures = {name: {"bytes": things.picture(name, unix), "path": None} for name in things.cameras}
            rows.append(
                {
                    "observation.state": state,
                    "action": after,
                    **pictures,
                    "timestamp": frame / self._fps,
                    "frame_index": frame,
                    "episode_index": number,
                    "index": self.frames + frame,
                    "task_index": self._tasks.index(episode.task),
                }
            )
        return rows

    def _count(self, statistics: Mapping[str, _Statistics], row: Mapping[str, Any]) -> None:
        from PIL import Image, ImageStat

        for name, value in row.items():
            if name not in self._things.cameras:
                statistics[name].add(cast("list[float]", value if isinstance(value, list) else [value]))
            elif row["frame_index"] % self._fps == 0:  # once a second is enough, as LeRobot samples, too
                with Image.open(io.BytesIO(value["bytes"]), formats=["JPEG"]) as image:
                    seen = ImageStat.Stat(image.convert("RGB"))
                statistics[name].add_many(
                    [mean / WHITE for mean in seen.mean],
                    [least / WHITE for least, _ in seen.extrema],
                    [most / WHITE for _, most in seen.extrema],
                    [variance / WHITE**2 for variance in seen.var],
                )

    def _schema(self) -> pa.Schema:
        import pyarrow as pa

        vector = pa.list_(pa.float32(), len(self._things.names))
        picture = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        return pa.schema(
            [
                ("observation.state", vector),
                ("action", vector),
                *((name, picture) for name in self._things.cameras),
                ("timestamp", pa.float32()),
                *((name, pa.int64()) for name in COUNTS),
            ]
        )

    def _put(self, rows: list[dict[str, Any]]) -> None:
        """Write frames into the present file, or into the next one when that is large."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        if self._data is not None and self._bytes > FILE_SIZE * 1_000_000:
            self._data.close()
            self._data, self._bytes, self._file = None, 0, self._file + 1
        if self._data is None:
            path = self._path("data", self._file)
            self._data = pq.ParquetWriter(path, self._schema(), compression="snappy")
        table = pa.Table.from_pylist(rows, schema=self._schema())
        self._data.write_table(table)
        self._bytes += table.nbytes

    def _path(self, kind: str, number: int) -> Path:
        place = PLACE.format(chunk_index=number // CHUNK, file_index=number % CHUNK)
        path = self._folder / kind / place
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def close(self) -> None:
        """Write what is known at the end."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._data.close()
        pq.write_table(pa.Table.from_pylist(self._rows), self._path("meta/episodes", 0))
        pq.write_table(_tasks_table(self._tasks), self._folder / "meta" / "tasks.parquet")
        stats = {
            name: each.structure(deep=name in self._things.cameras) for name, each in self._whole.items()
        }
        for name, content in (("info", self._info()), ("stats", stats)):
            (self._folder / "meta" / f"{name}.json").write_text(
                json.dumps(content, indent=4), encoding="utf-8"
            )

    def _info(self) -> dict[str, Any]:
        names = list(self._things.names)
        vector = {"dtype": "float32", "shape": [len(names)], "names": names}
        features: dict[str, Any] = {"observation.state": vector, "action": vector}
        for name, (height, width) in self._things.sizes.items():
            shape = {"shape": [height, width, 3], "names": ["height", "width", "channels"]}
            features[name] = {"dtype": "image", **shape}
        features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
        features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in COUNTS}
        return {
            "codebase_version": VERSION,
            "robot_type": "robotree",
            "total_episodes": len(self._rows),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": FILE_SIZE,
            "video_files_size_in_mb": 200,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._rows)}"},
            "data_path": f"data/{PLACE}",
            "video_path": None,
            "features": features,
        }


def _tasks_table(tasks: Sequence[str]) -> pa.Table:
    """Return the tasks as pandas keeps a frame whose index is the task."""
    import pyarrow as pa

    def column(name: str, kind: str, held: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": held, "metadata": None}

    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    table = pa.table(
        {"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())}
    )
    return table.replace_schema_metadata({"pandas": json.dumps(about)})

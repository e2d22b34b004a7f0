"""Reads a LeRobot data set with the packages on which LeRobot's loader stands, and prints what it found.

As `lerobot.datasets` does: the tasks with pandas, whose index they are; episodes and frames with `datasets`,
with the features of info.json.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import datasets  # type: ignore[import-not-found] # pyright: ignore[reportMissingImports]
import pandas as pd  # type: ignore[import-not-found,import-untyped] # pyright: ignore[reportMissingImports]


def main() -> None:
    """Read the set in a folder."""
    root = Path(sys.argv[1])
    info = json.loads((root / "meta" / "info.json").read_text())
    tasks = pd.read_parquet(root / "meta" / "tasks.parquet")
    features = {}
    for name, about in info["features"].items():
        if about["dtype"] == "image":
            features[name] = datasets.Image()
        elif about["shape"] == [1]:
            features[name] = datasets.Value(about["dtype"])
        else:
            features[name] = datasets.List(feature=datasets.Value(about["dtype"]), length=about["shape"][0])
    frames = datasets.Dataset.from_parquet(
        sorted(map(str, (root / "data").glob("*/*.parquet"))), features=datasets.Features(features)
    )
    episodes = datasets.Dataset.from_parquet(
        sorted(map(str, (root / "meta" / "episodes").glob("*/*.parquet")))
    )
    frame = frames[0]
    picture = frame["observation.images.cell_top"]
    found = {
        "task": tasks.iloc[frame["task_index"]].name,
        "frames": len(frames),
        "episodes": len(episodes),
        "state": frame["observation.state"],
        "picture": [picture.width, picture.height],
    }
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()

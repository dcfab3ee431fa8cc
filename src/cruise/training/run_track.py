"""The track of a run, which the run keeps: what happens to the file that it came from does not matter any more."""

import hashlib
import os
from pathlib import Path

from cruise.config import Track, TrainConfig
from cruise.errors import CruiseError
from cruise.racing.random_track import training_track
from cruise.racing.track_file import load_track, save_track
from cruise.storage.atomic import read_bytes

TRACK = "track.toml"


def run_track(folder: Path, config: TrainConfig) -> Track:
    """The track of an earlier run, as it was when the run began.

    Raises:
        CruiseError: the run is from before runs kept their tracks, and it is not found where it was.
    """
    kept = folder / TRACK
    return load_track(kept) if os.path.exists(kept) else training_track(config)


def keep_track(folder: Path, track: Track) -> str:
    """Write the track into the folder of its run, and give the file's checksum.

    Tracks that every race draws anew are not written, as the run's seed gives them; their checksum is empty.
    """
    if track.variants:
        return ""
    save_track(track, folder / TRACK)
    return _checksum(folder)


def check_track(folder: Path, track: Track, checksum: str | None) -> str:
    """The checksum of the kept track. Raises CruiseError where that is no longer what it was, or another than `track`.

    `checksum` is None in runs that kept no track; they do from now on.
    """
    if checksum is None:
        return keep_track(folder, track)
    place = folder / TRACK
    if checksum and _checksum(folder) != checksum:
        raise CruiseError(f"{place} has been changed since this run began: put it back, or start a new run")
    if checksum and load_track(place) != track:
        raise CruiseError(f"this run began on another track, that of {place}: go on with that, or start a new run")
    return checksum


def _checksum(folder: Path) -> str:
    return hashlib.sha256(read_bytes(folder / TRACK, "track of the run")).hexdigest()

"""The wheel, installed by pip as its users do: every Python that is here, no constraints, another folder and user.

    python -m benchmarks.wheel [3.12 ...]

Each gets an environment of its own. Then `cruise race` flies by that environment alone: from an empty folder, as
nobody, with a home that cannot be written, and no network (where this machine's `unshare` allows it). Each line is one
Python: processor seconds and MB of the installation, and processor seconds of `cruise --help` and of the first race.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
ALONE = ["unshare", "--user", "--map-user=65534", "--map-group=65534", "--net"]
RACE = ["race", "--drones", "2", "--laps", "1", "--html", "None", "--png", "None", "--log", "race.npz"]
CHECK = "import cruise, sys; log = cruise.race('ring', 2, laps=1); assert log.position_w.shape[1] == 2; sys.exit(0)"


def find_python(version: str) -> str | None:
    """Of that version, on the path or among pyenv's."""
    found = shutil.which(f"python{version}")
    if found and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0:
        return found
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    built = sorted(root.glob(f"versions/{version}.*/bin/python{version}"))
    return str(built[-1]) if built else None


def seconds(command: list[str], **options: object) -> float:
    """Of a processor that it took. Raises CalledProcessError where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True, text=True, **options)  # type: ignore[call-overload]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def megabytes(folder: Path) -> float:
    """Of all files below a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file() and not file.is_symlink()) / 1e6


def check(version: str, python: str, wheel: Path, place: Path) -> str:
    """One Python, in words."""
    venv, home, folder = (place / name for name in ("venv", "home", "elsewhere"))
    subprocess.run([python, "-m", "venv", str(venv)], check=True)
    bare = megabytes(venv)
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PIP_CONSTRAINT")}
    installing = seconds([str(venv / "bin/pip"), "install", "--quiet", str(wheel)], env=clean)
    size = megabytes(venv) - bare
    home.mkdir(mode=0o555)
    folder.mkdir()
    folder.chmod(0o777)
    alone = ALONE if subprocess.run([*ALONE, "true"], capture_output=True, check=False).returncode == 0 else []
    env = {"HOME": str(home), "PATH": f"{venv / 'bin'}:/usr/bin:/bin", "MPLCONFIGDIR": str(folder)}
    told = [str(venv / "bin/python"), "-m", "cruise"]
    helping = seconds([*alone, *told, "--help"], env=env, cwd=folder)
    racing = seconds([*alone, *told, *RACE], env=env, cwd=folder)
    seconds([*alone, str(venv / "bin/python"), "-c", CHECK], env=env, cwd=folder)
    written = sorted(file.name for file in folder.iterdir() if file.suffix == ".npz")
    assert written == ["race.npz"], written
    assert not list(home.iterdir())
    said = "no network, nobody" if alone else "with network, as this user"
    return (
        f"{installing:.0f} s and {size:.0f} MB to install; --help {helping:.1f} s, first race {racing:.0f} s ({said})"
    )


def main() -> int:
    """Every Python; 1 where one fails."""
    failed = 0
    with tempfile.TemporaryDirectory() as made:
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", made, str(ROOT)]
        subprocess.run(pip, check=True, capture_output=True)
        wheel = next(Path(made).glob("*.whl"))
        for version in sys.argv[1:] or PYTHONS:
            python = find_python(version)
            if python is None:
                print(f"{version}: not here", flush=True)
                continue
            place = Path(made) / version
            place.mkdir()
            try:
                print(f"{version}: {check(version, python, wheel, place)}", flush=True)
            except subprocess.CalledProcessError as error:
                print(f"{version}: FAILED: {' '.join(error.cmd[-8:])}: {(error.stderr or '')[-1500:]}", flush=True)
                failed = 1
            shutil.rmtree(place)
    return failed


if __name__ == "__main__":
    sys.exit(main())

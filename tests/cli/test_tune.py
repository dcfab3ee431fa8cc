"""`cruise tune` says what is wrong before Ray starts."""

import pytest

from cruise.cli.main import main


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (["--only", "races"], "'races' is not searched; these are: learning_rate, "),
        (["--samples", "0"], "--samples must be between 1 and 100000, not 0"),
        (["--track", "split-s", "--track", "rnig"], "unknown track 'rnig': did you mean 'ring'?"),
        (["--vehicle", "racr"], "unknown vehicle 'racr': did you mean 'racer'?"),
        (["--drones", "17"], "drones must be between 1 and 16, not 17"),
        (["--step-scale", "0.0001"], "the budget is smaller than one update of 32,768 steps"),
        (["--out", "nowhere", "--resume"], "nowhere: no search to resume here"),
    ],
)
def test_bad_input_is_told_in_one_line(flags, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["tune", *flags]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
    assert list(tmp_path.iterdir()) == []

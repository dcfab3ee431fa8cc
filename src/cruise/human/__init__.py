"""People in the race: the page that they fly by, the race in real time, their best laps."""

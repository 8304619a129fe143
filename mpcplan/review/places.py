"""The folders and names of files in a benchmark's results; quick to import."""

TRACES, SOLUTIONS = "traces", "solutions"
PICTURES, FILMS = "pictures", "animations"  # those that `show` adds
TRACE = ".json.gz"  # after the scenario's id

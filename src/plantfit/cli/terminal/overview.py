"""`plantfit --help`: the commands in the order of the work, each in one line that fits 80 columns."""

from collections.abc import Iterator, Mapping, Sequence

SECTIONS: Mapping[str, Mapping[str, str]] = {
    "Begin": {
        "demo": "See a real machine worked end to end",
        "init": "Write a study file from a recording",
        "new": "Write a study file from a list of parts, or from the library",
        "look": "Responses, delay and best linear model, without equations",
        "check": "Read a study file; say what its records can determine",
    },
    "Fit": {
        "run": "Search the parameters, judge them, write the report",
        "resume": "Go on with a study that was stopped, bit for bit",
        "list": "List the studies of a store",
        "report": "Write the report of a study again",
        "predict": "Simulate a fitted model over a recording, with bands",
    },
    "Understand": {
        "diagnose": "What is missing in the model, and how much it explains",
        "compare": "Which of several models, or search methods, is better",
        "compare-records": "Whether recordings agree, and which one does not",
        "intervals": "Covariance, profile, bootstrap, posterior side by side",
        "estimate": "Maximum likelihood and Kalman filters beside the fit",
        "sensitivity": "Which parameters the cost reacts to",
        "combine": "Write a study of the combinations that are determined",
    },
    "Next step": {
        "design": "The input to record next, within limits",
        "tune": "A controller for every plant that the data allow",
        "export": "The plant for Python, C, CasADi, MATLAB and others",
    },
    "Bench": {
        "excite": "Make a signal that excites a plant, within limits",
        "record": "Play such a signal on a board and record its answer",
        "track": "Follow states and parameters on line, with an alarm",
        "rig": "Record a virtual plant whose constants are known",
    },
    "Store": {
        "export-study": "Write a study to a file for another store",
        "import": "Bring exported studies into a store",
        "merge": "Bring the studies of other stores into this one",
        "workers": "Show what every worker does now",
    },
    "Reference": {
        "methods": "The search methods, or one with its settings",
        "models": "The models of the library, or one with its equations",
        "schema": "The JSON schema of study files, for editors",
        "tune-search": "Tune the settings of a search method on your problem",
    },
}


def sections(commands: Sequence[str]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Title and (command, summary) of each section, names padded to one width; commands that no section names come last."""
    width = max(map(len, commands), default=0)
    named = {name for rows in SECTIONS.values() for name in rows}
    for title, rows in (*SECTIONS.items(), ("More", {name: "" for name in commands if name not in named})):
        if own := [(name.ljust(width), said) for name, said in rows.items() if name in commands]:
            yield title, own

"""Make the README's tables from the recorded results: `python -m dronekeypp reproduce claims`.

There are three: the results in short, what `reproduce` can be asked, and every claim of the paper with its
verdict. A verdict that no longer fits the results is an error.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.files import write_beside
from dronekeypp.reproduce import ablations
from dronekeypp.reproduce.claim_list import CLAIMS
from dronekeypp.reproduce.comparisons import chance_sentence
from dronekeypp.reproduce.evidence import Results, printed
from dronekeypp.reproduce.picture import sheet
from dronekeypp.reproduce.protocol import Table
from dronekeypp.reproduce.results import PAPER
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.tables import PER_AXIS_READING, count_seeds, line
from dronekeypp.reproduce.verdicts import DIFFERS, NOT_ATTEMPTED, REPRODUCED, SAME_ORDER, VERDICTS, Claim

__all__ = [
    "BENCHMARK",
    "CLAIMS",
    "DIFFERS",
    "NOT_ATTEMPTED",
    "REPRODUCED",
    "SAME_ORDER",
    "VERDICTS",
    "Claim",
    "Claims",
    "Results",
    "benchmark",
    "fill_readme",
    "in_short",
    "markdown",
    "reproduce",
    "source_of",
]

# What `reproduce NAME` asks.
BENCHMARK = {
    "table3": "Table 3: DroneKey++ beside DroneKey, DronePose and YOLOv8n-pose + PnP",
    "rates": "The learning rate of each method, chosen on the validation scenes",
    "beyond": "The paper's network beside ours, and what our claimed uncertainty is worth",
    **{name: ablation.title for name, ablation in ablations.ABLATIONS.items()},
    "priors": "Told a wrong class; a drone left out of training; what the class embedding holds",
    "domains": "Drawn environments or 360° photographs of yours (`--photographs DIR`)",
    "figure6": "How far four sets of pictures are from real frames (or from yours: `--real DIR`)",
}


class Claims(Table):
    """Write the README's tables and its picture.

    Nothing is trained.
    """

    name = "claims"

    def reproduce(self, bench: Bench, seeds: int | None = None) -> dict[str, Any]:
        return reproduce(bench.root)


def reproduce(root: Path) -> dict[str, Any]:
    """Write the three tables into README.md and its picture into figures/.

    Returns:
        {"claims": the number of claims}, and with each verdict the number of claims that have it.

    Raises:
        InputError: A result or the README is missing, the results are of different editions, or a verdict no
            longer holds (the message names it).
    """
    results = Results(root)
    results.check_editions(BENCHMARK)
    for claim in CLAIMS:
        if claim.holds and not claim.holds(results):
            verdict = claim.derived_verdict(results)
            raise InputError(
                f"{claim.where}, {claim.says}: the verdict “{verdict}” no longer fits the results; "
                "look at it again"
            )
    path = root / "README.md"
    if not path.is_file():
        raise InputError(f"{path} not found: call it in the repository, or name it with --root")
    write_beside(path, fill_readme(path.read_text(encoding="utf-8"), results).encode())
    write_beside(root / "figures" / "overlay.jpg", sheet(root / "data_samples"))
    counts = {"claims": len(CLAIMS)}
    derived = [claim.derived_verdict(results) for claim in CLAIMS]
    counts |= {verdict: derived.count(verdict) for verdict in VERDICTS}
    return counts


def fill_readme(readme: str, results: Results) -> str:
    """Return a README with the three tables put between their marks.

    Raises:
        InputError: The marks are missing.
    """
    tables = {
        "results": in_short(results),
        "benchmark": benchmark(results),
        "claims": markdown(results),
    }
    for name, table in tables.items():
        begin = f"<!-- {name}: made by `python -m dronekeypp reproduce claims` -->"
        end = f"<!-- end of {name} -->"
        if begin not in readme or end not in readme.partition(begin)[2]:
            raise InputError(f"README.md has lost the marks of its table: {begin} … {end}")
        before, _, rest = readme.partition(begin)
        after = rest.partition(end)[2]
        readme = f"{before}{begin}\n\n{table}\n{end}{after}"
    return readme


def markdown(results: Results) -> str:
    """Return the table of claims as Markdown.

    Its links are relative to the repository's root.
    """
    lines = ["| paper | it says | where | paper's value | ours | verdict |", "|---|---|---|---|---|---|"]
    for claim in CLAIMS:
        name = claim.code.rpartition(".")[2]
        test = claim.test.partition("::")[0]
        place = f"{claim.notebook[:2]} § {claim.section}"
        links = [
            f"[`{name}`]({source_of(claim.code)})",
            f"[test](tests/{test})",
            f"[{place}](notebooks/{claim.notebook}.ipynb)",
        ]
        ours = claim.ours(results) if claim.ours else ""
        verdict = f"**{claim.derived_verdict(results)}{claim.mark(results)}**"
        reason = claim.reason(results)
        if reason:
            verdict += f": {reason}"
        lines.append(line([claim.where, claim.says, " · ".join(links), claim.paper, ours, verdict]))
    compared = [claim.compares for claim in CLAIMS if claim.compares]
    count = sum(len(comparison.references) * len(comparison.keys) for comparison in compared)
    lines += ["", f"(The verdicts on orders of rows rest on {count} comparisons. {chance_sentence(count)})"]
    return "\n".join(lines) + "\n"


def source_of(code: str) -> str:
    """Return the file, from the repository's root, that holds a dotted name below dronekeypp.

    Raises:
        InputError: There is no such module.
    """
    package, parts = Path(__file__).parents[1], code.split(".")
    for n in range(len(parts), 0, -1):
        module = package.joinpath(*parts[:n])
        for candidate in (module.with_suffix(".py"), module / "__init__.py"):
            if candidate.is_file():
                return f"src/dronekeypp/{candidate.relative_to(package)}"
    raise InputError(f"{code}: no such module")


def in_short(results: Results) -> str:
    """Return the results in three lines: the paper's, those of its network measured here, and ours.

    A text after them says what the columns are.
    """
    rotation, translation = printed("table3", "DroneKey++").split(", ")
    lines = [
        "| | rotation MAE / MedAE | translation MAE / MedAE | class | frames/s, CPU |",
        "|---|---|---|---|---|",
        line(["the paper, on its data", rotation, translation, "–", f"{PAPER['speed']['cpu_fps']:.0f}"]),
        _network_line(results, "DroneKey++", "its method at laptop size, on our data", "table3", None),
        _network_line(
            results,
            "DroneKey++, geometric",
            "ours: other heads and losses, and a solver that starts from measured hub shapes (notebook 12)",
            "beyond",
            "geometric",
        ),
    ]
    exported = results.fps("DroneKey++", "ONNX Runtime", "ratio_to_yolov8n_pose")
    eager = results.fps("DroneKey++", "eager", "ratio_to_yolov8n_pose")
    large = results.fps("DroneKey++, paper-sized", "eager")
    lines += [
        "",
        "(Test scenes 6 and 7, seven drones: the mean of these 14 columns of Table 3; for the paper, the "
        "average it prints. MAE: mean error, MedAE: median. The translation's MAE is a mean over the three "
        "axes, as the paper's seems to be, and in brackets the mean distance; its MedAE is a distance: "
        f"{PER_AXIS_READING} A question mark: fewer than three trainings. Two data sets: the order of "
        "magnitude compares, the digits do not. Frames a second: batch 1, two cores, from full HD frame and "
        "box to pose, with ONNX Runtime (in brackets: plain PyTorch); that is "
        f"{exported:.0f} ({eager:.0f}) times as fast as YOLOv8n-pose + PnP in its own library. "
        f"A network of the paper's size does {large:.0f} here.)",
    ]
    return "\n".join(lines) + "\n"


def _network_line(results: Results, name: str, title: str, table: str, variant: str | None) -> str:
    """Return the line of one of our networks in `in_short`.

    Args:
        results: the recorded results.
        name: its name in the speed table.
        title: what it is called.
        table: the result that holds its row.
        variant: the variant of that row.
    """
    text = results.pose(table, variant=variant)
    mark = "?" if text.endswith("?") else ""
    rotation, translation = text.split(", ")
    speed = f"{results.fps(name, 'ONNX Runtime'):.0f} ({results.fps(name, 'eager'):.0f})"
    accuracy = results.row(table, variant=variant)["class_accuracy"]
    return line([title, rotation + mark, translation, f"{100 * accuracy:.0f} %{mark}", speed])


def benchmark(results: Results) -> str:
    """Return a table of what `reproduce` can be asked, and of what has been recorded of it."""
    lines = ["| `reproduce …` | asks | recorded | minutes |", "|---|---|---|---:|"]
    for name, question in BENCHMARK.items():
        try:
            runs = results[name]["runs"]
        except InputError:
            lines.append(f"| `{name}` | {question} | not yet | |")
            continue
        recorded, minutes = f"[figures/{name}.md](figures/{name}.md)", ""
        if runs:
            recorded += f", {len(runs)} trainings, {count_seeds(results[name])}"
            minutes = f"{sum(run['minutes'] for run in runs):.0f}"
        lines.append(f"| `{name}` | {question} | {recorded} | {minutes} |")
    return "\n".join(lines) + "\n"

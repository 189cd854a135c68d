"""The learning curve: a line of a table at each look, and the table as a picture."""

import csv

COLUMNS = ("phase", "size", "samples", "seconds", "rate", "waiting", "loss")
"""Before the errors on the validation scenes. `seconds` of training in all; `waiting`: share of them spent on data."""


def written(table, look):
    """The look as one more line of the CSV table."""
    new = not table.exists()
    with open(table, "a", newline="") as file:
        writer = csv.DictWriter(file, look)
        if new:
            writer.writeheader()
        writer.writerow(look)


def drawn(table, picture, title):
    """The table's errors over training samples, a dotted line where a phase began."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with open(table) as file:
        looks = list(csv.DictReader(file))
    figure, axes = pyplot.subplots(figsize=(6, 3.4))
    for name in looks[0]:
        if name not in COLUMNS:
            axes.plot([int(look["samples"]) for look in looks], [float(look[name]) for look in looks], label=name)
    for before, look in zip(looks, looks[1:]):
        if look["phase"] != before["phase"]:
            axes.axvline(int(before["samples"]), color="gray", linestyle=":", linewidth=1)
            axes.text(int(before["samples"]), axes.get_ylim()[1], f" {look['size']}²", va="top", color="gray")
    axes.set(xlabel="training samples seen", ylabel="mean squared error", yscale="log", title=title)
    axes.legend()
    figure.savefig(picture, dpi=80, bbox_inches="tight")
    pyplot.close(figure)

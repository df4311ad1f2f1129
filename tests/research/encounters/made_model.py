"""A small encounter model in the text of its file, with numbers of the test's own."""

GRAPH = """0 1 0 0 0
0 0 1 0 1
0 0 0 0 0
0 0 0 0 0
0 0 0 0 0"""

# Climb at t+1 depends on height and climb; turn at t+1 on speed, turn, and climb at t+1, which comes before.
LATER = """0 0 0 0 0 0 1 0
0 0 0 0 0 0 0 1
0 0 0 0 0 1 0 0
0 0 0 0 0 0 1 0
0 0 0 0 0 0 0 1
0 0 0 0 0 0 0 0
0 0 0 0 0 0 0 1
0 0 0 0 0 0 0 0"""

STAYS = "900 60 40 50 900 50 40 60 900"


def text(**sections):
    """The file's text, with some sections replaced; None leaves one out."""
    labels = r'"L", "v", "\dot v", "\dot h", "\dot \psi"'
    later = (
        r'"L", "v", "\dot v(t)", "\dot h(t)", "\dot \psi(t)", "\dot v(t+1)", "\dot h(t+1)", "\dot \psi(t+1)"'
    )
    known = {
        "labels_initial": labels,
        "G_initial": GRAPH,
        "r_initial": "2 2 3 3 3",
        # L; v for each L; acceleration for each v; climb; turn for each v
        "N_initial": "300 100  70 30 20 80  10 80 10 5 90 5  25 50 25  30 40 30 5 90 5",
        "labels_transition": later,
        "G_transition": LATER,
        "r_transition": "2 2 3 3 3 3 3 3",
        "N_transition": " ".join([STAYS, *[STAYS] * 2, *[STAYS] * 6]),
        "boundaries": "300 500 1200\n60 100 140\n-2 -0.5 0.5 2\n-1000 -200 200 1000\n-6 -1 1 6",
        "resample_rates": "0 0 0.1 0.2 0.3",
    } | sections
    return "\n".join(f"# {name}\n{lines}" for name, lines in known.items() if lines is not None) + "\n"

#!/usr/bin/env python3
"""Executes docs/python.ipynb and keeps its outputs in it, without times and with small pictures.

Usage: scripts/notebook.py    in an environment with rebond, matplotlib, nbconvert, ipykernel and pillow
"""
import base64
import io
import pathlib

import nbformat
from nbconvert.preprocessors import ExecutePreprocessor
from PIL import Image

FILE = pathlib.Path(__file__).parent.parent / "docs" / "python.ipynb"
COLOURS, ROUNDS = 256, 10


def small(picture):
    """Returns a PNG picture in base64 with a palette in place of 24 bits per pixel."""
    image = Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB")
    kept = io.BytesIO()
    image.quantize(COLOURS, kmeans=ROUNDS).save(kept, "png", optimize=True)
    return base64.b64encode(kept.getvalue()).decode()


notebook = nbformat.read(FILE, 4)
metadata = dict(notebook.metadata)
ExecutePreprocessor(record_timing=False).preprocess(notebook)
# The version of Python is no part of the page.
notebook.metadata = metadata
for cell in notebook.cells:
    for output in cell.get("outputs", []):
        if "image/png" in output.get("data", {}):
            output.data["image/png"] = small(output.data["image/png"])
nbformat.write(notebook, FILE)

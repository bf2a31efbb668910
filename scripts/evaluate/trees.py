"""The score of the core as integer trees: taken from a fitted model, computed, and written into the core.

A tree has seven nodes and eight ends. Node `i` leads to nodes 2 i + 1 and 2 i + 2: to the second
when its property is above its limit. Log-odds are counted in steps of 1/32.
"""

import math
import re
import sys
from dataclasses import dataclass

import numpy as np

STEPS = 32  # of a leaf in one unit of log-odds
LEVELS, NODES = 3, 7
MOST = 127  # of a leaf

TABLE = re.compile(r"(#\[rustfmt::skip\]\n)const TREES: \[Tree; \d+\] = \[\n.*?\n\];\n", re.DOTALL)
BIAS = re.compile(r"const BIAS: i32 = -?\d+;")


@dataclass
class Tree:
    """The properties and limits of the nodes, and the log-odds of the ends, in steps."""

    property: list
    limit: list
    leaf: list


@dataclass
class Trees:
    """A score: the log-odds without any tree, in steps, and the trees."""

    bias: int
    trees: list

    def score(self, properties):
        """The scores of rows of properties, as the core computes them."""
        rows, total = np.arange(len(properties)), np.full(len(properties), self.bias)
        for tree in self.trees:
            at = np.zeros(len(properties), int)
            for _ in range(LEVELS):
                at = 2 * at + 1 + (properties[rows, np.array(tree.property)[at]] > np.array(tree.limit)[at])
            total += np.array(tree.leaf)[at - NODES]
        return 1 / (1 + np.exp(-total / STEPS))


def export(model):
    """The trees of a HistGradientBoostingClassifier of depth 3 that was fitted to bytes.

    scikit-learn offers no other way to its trees than attributes that are not public.
    """
    bias = round(float(np.ravel(model._baseline_prediction)[0]) * STEPS)
    return Trees(bias, [tree_of(predictor.nodes) for (predictor,) in model._predictors])


def tree_of(nodes):
    """One tree of the model; an end above the third level fills all ends below it."""
    tree = Tree([0] * NODES, [255] * NODES, [0] * (NODES + 1))

    def walk(node, at):
        if at >= NODES:
            tree.leaf[at - NODES] = max(-MOST, min(MOST, round(float(node["value"]) * STEPS)))
        elif node["is_leaf"]:
            walk(node, 2 * at + 1)
            walk(node, 2 * at + 2)
        else:
            # Whole numbers above 87.5 are those above 87.
            tree.property[at] = int(node["feature_idx"])
            tree.limit[at] = math.floor(node["num_threshold"])
            walk(nodes[node["left"]], 2 * at + 1)
            walk(nodes[node["right"]], 2 * at + 2)

    walk(nodes[0], 0)
    return tree


def read(path):
    """The text of the core's belief.rs or of a copy; ends the program when it is none."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except OSError as e:
        sys.exit(f"{path}: {e.strerror}; give core/src/detect/belief.rs or a copy of it")
    if len(TABLE.findall(text)) != 1 or len(BIAS.findall(text)) != 1:
        sys.exit(f"{path} has no table of trees; give core/src/detect/belief.rs or a copy of it")
    return text


def write(score, path):
    """Puts the trees and the bias into the core's belief.rs or a copy."""
    old = read(path)
    rows = "".join(f"    Tree::new({t.property}, {t.limit}, {t.leaf}),\n" for t in score.trees)
    new = TABLE.sub(lambda m: f"{m[1]}const TREES: [Tree; {len(score.trees)}] = [\n{rows}];\n", old)
    with open(path, "w", encoding="utf-8") as out:
        out.write(BIAS.sub(f"const BIAS: i32 = {score.bias};", new))

"""How to cite a dataset: the benchmark's paper, and ibdata with the content root."""

from __future__ import annotations

PAPER = """\
@inproceedings{hein2017benchmark,
  title     = {A Benchmark Environment Motivated by Industrial Control Problems},
  author    = {Hein, Daniel and Depeweg, Stefan and Tokic, Michel and Udluft, Steffen and Hentschel, Alexander
               and Runkler, Thomas A. and Sterzing, Volkmar},
  booktitle = {IEEE Symposium Series on Computational Intelligence},
  year      = {2017},
  eprint    = {1709.09480},
  archiveprefix = {arXiv}
}"""
IBDATA = """\
@software{{ibdata,
  title   = {{ibdata: offline reinforcement-learning datasets of the Industrial Benchmark}},
  author  = {{{{The ibdata developers}}}},
  version = {{{version}}},
  note    = {{Dataset {name}, content root {root}}}
}}"""


def bibtex(name: str, root: str, version: str) -> str:
    """The entries of BibTeX for a dataset with this name and content root, made by a version of ibdata."""
    return f"{PAPER}\n\n{IBDATA.format(name=name, root=root, version=version)}"

"""How Sphinx, which rosdoc2 calls, builds these documents; index.md lists them."""

project = 'wrist_ft_comp'
extensions = ['myst_parser']
source_suffix = {'.md': 'markdown'}
#: Links may name headings of three levels.
myst_heading_anchors = 3
exclude_patterns = ['generator']
#: Links that lead out of this folder are for readers of the repository.
suppress_warnings = ['myst.xref_missing', 'myst.header']

"""The .gitignore of a project folder: what orip makes of the texts is not kept under version control, the texts are."""

from __future__ import annotations

IGNORE_FILE = ".gitignore"

IGNORED = """\
# What orip makes of the texts: 'orip run' makes it again.

# Stores. What commands have changed (orip update, orip camera edit ...) is in them alone, until 'orip export-toml'
# writes it into orip.toml.
*.CAM
*.TIK
*.PHO
*.TEM
*.EXT
*.EXO
older-stores/
before_update.json

# listings, results, reports, drive tables
*_RESULT.OUT
*_ERROR.OUT
result.json
*_result.json
residuals.csv
*_residuals.csv
residuals.npz
*_residuals.npz
report.html
*_report.html
*.DRV

# photo points by sub-blocks, which the workers of 'orip solve --dask' read
.orip-sub-blocks/

# left by a run that was killed
*-journal
*-mj*
*-undo
*-pact
.orip-*.tmp
"""
"""Names by which git leaves files alone; none of them is that of a text that a user writes."""

"""Projects of other programs: imported as a project folder, results written back.

What a format reads is converted, tried by reprojection, and written as the texts of a project; nothing or all of it.
"""

from __future__ import annotations

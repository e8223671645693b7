"""Pure geometry: functions that return values and, where an adjustment needs them, partials."""

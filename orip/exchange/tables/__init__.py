"""Tables with a heading, as spreadsheets write them: cameras, photos, observations, control, points, stations."""

"""One function a command: read, compute, commit. The only place where files and maths meet."""

"""Interior orientation: plate to template to photo, and the camera's distortion."""

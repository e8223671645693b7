"""A flight beside its plan while it is flown: what the receiver says, how far the flight is, and its page."""

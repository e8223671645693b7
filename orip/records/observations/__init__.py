"""What is measured and given: the measurement log, photo observations and ground control.

The kinds of observation are listed here, with their units and the limits of their a-priori errors.
"""

"""What somebody probably mistook when they typed, named or measured something: units, names, signs, the wrong photo.

Every suspicion is tested against the data: undoing it has to explain the misfit.
"""

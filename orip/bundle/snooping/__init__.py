"""Data snooping: which observations may be wrong together, the search for those that are, and what was found.

`hypotheses` lists what is tested and finds what fails, `selection` chooses what is left out or taken back within one
linearisation, `search` alternates that with adjustments, `findings` gives the result in the user's names.
"""

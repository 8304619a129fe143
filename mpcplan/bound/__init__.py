"""The clairvoyant optimum: what was possible, for every result to be compared with."""

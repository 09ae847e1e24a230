"""Lei et al. 2014: danger degrees, then speeds, in two fuzzy layers."""

"""Analysis: from stored results to measures, comparisons and verdicts."""

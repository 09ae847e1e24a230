"""Reading: tables, figures, claims and reports, from stored results only."""

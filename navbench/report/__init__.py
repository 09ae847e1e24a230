"""Reports: tables, figures and documents, from stored results only."""

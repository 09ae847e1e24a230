"""One navigation method a file, each reading like its paper."""

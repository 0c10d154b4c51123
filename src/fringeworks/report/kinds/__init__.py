"""What is shown of each kind of result: a file here for each file in which results are defined."""

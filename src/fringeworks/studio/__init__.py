"""The studio: a page in the browser that sets up, calibrates, scans, looks and exports."""

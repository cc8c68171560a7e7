"""Pages for the browser: one file of HTML that shows a result and the motions of its points."""

"""Error against run time: methods that simulate impacts, beside exact impacts."""

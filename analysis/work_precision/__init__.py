"""Error against run time: methods that simulate impacts, compared with exact impacts."""

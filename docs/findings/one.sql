SELECT pos AS detected FROM events WHERE event ->> '$.ok' = 1

SELECT pos AS detected FROM events WHERE event ->> '$.user' <> 'root'

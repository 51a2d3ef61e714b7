SELECT max(a.pos, b.pos) AS detected
FROM events AS a, events AS b
WHERE a.event ->> '$.action' = 'login' AND b.event ->> '$.user' = 'root'

(* JSON (RFC 8259) with the numbers NaN, Infinity and -Infinity, which Python writes. Refused are
   repeated keys, and as in logs of `rvaft monitor` lone surrogates and numbers of very many digits. *)

type t =
  | Null
  | Bool of bool
  | Number of string            (* as it is written *)
  | String of int list          (* code points *)
  | List of t list
  | Object of (int list * t) list

exception Bad of int * string

let max_depth = 500
let max_digits = 4300

(* Append a code point in UTF-8. *)
let add_utf8 buffer c =
  let byte b = Buffer.add_char buffer (Char.chr b) in
  if c < 0x80 then byte c
  else if c < 0x800 then (byte (0xC0 lor (c lsr 6)); byte (0x80 lor (c land 0x3F)))
  else if c < 0x10000 then (
    byte (0xE0 lor (c lsr 12)); byte (0x80 lor ((c lsr 6) land 0x3F)); byte (0x80 lor (c land 0x3F)))
  else (
    byte (0xF0 lor (c lsr 18)); byte (0x80 lor ((c lsr 12) land 0x3F));
    byte (0x80 lor ((c lsr 6) land 0x3F)); byte (0x80 lor (c land 0x3F)))

let text_of points =
  let buffer = Buffer.create 16 in
  List.iter (add_utf8 buffer) points;
  Buffer.contents buffer

(* The beginning of a text for a message: printable ASCII, other characters as escapes. *)
let shown points =
  let short = List.filteri (fun i _ -> i < 60) points in
  let one c = if c < 32 || c > 126 then Printf.sprintf "\\u%04x" c else String.make 1 (Char.chr c) in
  String.concat "" (List.map one short) ^ if List.compare_length_with points 60 > 0 then "..." else ""

(* The code points of a text in ASCII. *)
let points_of text = List.init (String.length text) (fun i -> Char.code text.[i])

let parse ?(surrogates = false) (s : string) : t =
  let n = String.length s in
  let bad i what = raise (Bad (i + 1, what)) in
  let rec skip i = if i < n && (match s.[i] with ' ' | '\t' | '\n' | '\r' -> true | _ -> false) then skip (i + 1)
      else i in
  let is_digit i = i < n && s.[i] >= '0' && s.[i] <= '9' in
  let rec digits i = if is_digit i then digits (i + 1) else i in
  let word i w v = if i + String.length w <= n && String.sub s i (String.length w) = w then (v, i + String.length w)
      else bad i "not JSON" in
  let number i =
    let j = if i < n && s.[i] = '-' then i + 1 else i in
    if not (is_digit j) then bad i "not JSON";
    let k = if s.[j] = '0' then j + 1 else digits j in
    let k = if k < n && s.[k] = '.' then (if is_digit (k + 1) then digits (k + 1) else
        bad k "a digit must follow the point") else k in
    let k =
      if k < n && (s.[k] = 'e' || s.[k] = 'E') then
        let l = if k + 1 < n && (s.[k + 1] = '-' || s.[k + 1] = '+') then k + 2 else k + 1 in
        if is_digit l then digits l else bad k "a digit must follow the exponent"
      else k in
    if k - j > max_digits then begin
      let count = ref 0 in
      for l = j to k - 1 do if is_digit l then incr count done;
      if !count > max_digits then bad i (Printf.sprintf "a number of more than %d digits" max_digits)
    end;
    (Number (String.sub s i (k - i)), k) in
  let hex i =
    if i + 4 > n then bad i "four hexadecimal digits must follow \\u";
    let value c = match c with
      | '0' .. '9' -> Char.code c - 48 | 'a' .. 'f' -> Char.code c - 87 | 'A' .. 'F' -> Char.code c - 55
      | _ -> bad i "four hexadecimal digits must follow \\u" in
    ((value s.[i] * 16 + value s.[i + 1]) * 16 + value s.[i + 2]) * 16 + value s.[i + 3] in
  let continuation i least =
    if i < n && Char.code s.[i] land 0xC0 = 0x80 && Char.code s.[i] >= least then Char.code s.[i] land 0x3F else
        bad i "not UTF-8" in
  let string i =
    let rec go i found =
      if i >= n then bad i "the string does not end"
      else match s.[i] with
        | '"' -> (List.rev found, i + 1)
        | '\\' ->
          if i + 1 >= n then bad i "the string does not end";
          let one c = go (i + 2) (c :: found) in
          (match s.[i + 1] with
           | '"' -> one 34 | '\\' -> one 92 | '/' -> one 47 | 'b' -> one 8 | 'f' -> one 12
           | 'n' -> one 10 | 'r' -> one 13 | 't' -> one 9
           | 'u' ->
             let c = hex (i + 2) in
             let alone () =
               if c >= 0xD800 && c < 0xE000 && not surrogates then
                 bad i "a lone surrogate: \\ud800 to \\udfff stand only in pairs"
               else go (i + 6) (c :: found) in
             if c >= 0xD800 && c < 0xDC00 && i + 7 < n && s.[i + 6] = '\\' && s.[i + 7] = 'u' then
               let d = hex (i + 8) in
               if d >= 0xDC00 && d < 0xE000 then go (i + 12) ((0x10000 + ((c - 0xD800) lsl 10) + (d - 0xDC00)) :: found)
               else alone ()
             else alone ()
           | _ -> bad i "unknown escape")
        | c when c < ' ' -> bad i "a control character in a string"
        | c when c < '\x80' -> go (i + 1) (Char.code c :: found)
        | c ->
          let b = Char.code c in
          let at k = continuation (i + k) 0x80 in
          if b >= 0xC2 && b < 0xE0 then go (i + 2) ((((b land 0x1F) lsl 6) lor at 1) :: found)
          else if b >= 0xE0 && b < 0xF0 then
            let p = ((b land 0x0F) lsl 12) lor (at 1 lsl 6) lor at 2 in
            if p < 0x800 || (p >= 0xD800 && p < 0xE000) then bad i "not UTF-8" else go (i + 3) (p :: found)
          else if b >= 0xF0 && b < 0xF5 then
            let p = ((b land 0x07) lsl 18) lor (at 1 lsl 12) lor (at 2 lsl 6) lor at 3 in
            if p < 0x10000 || p > 0x10FFFF then bad i "not UTF-8" else go (i + 4) (p :: found)
          else bad i "not UTF-8" in
    go i [] in
  (* Refuse a key that stands twice; keys come with their places. *)
  let distinct keys =
    let rec go = function
      | (name, _) :: (((again, i) :: _) as rest) ->
        if name = again then bad i (Printf.sprintf "the key \"%s\" is repeated" (shown name)) else go rest
      | _ -> () in
    match keys with [] | [ _ ] -> () | _ -> go (List.sort compare keys) in
  let rec value depth i =
    if depth > max_depth then bad i "nested too deeply";
    let i = skip i in
    if i >= n then bad i "the text ends too early"
    else match s.[i] with
      | '{' ->
        let rec fields i found keys =
          let i = skip i in
          if i >= n || s.[i] <> '"' then bad i "a field needs a name in quotes"
          else
            let name, j = string (i + 1) in
            let keys = (name, i) :: keys and i = j in
            let i = skip i in
            if i >= n || s.[i] <> ':' then bad i "a colon must follow the name of a field";
            let v, i = value (depth + 1) (i + 1) in
            let i = skip i in
            if i < n && s.[i] = ',' then fields (i + 1) ((name, v) :: found) keys
            else if i < n && s.[i] = '}' then (distinct keys; (Object (List.rev ((name, v) :: found)), i + 1))
            else bad i "a comma or } must follow" in
        let j = skip (i + 1) in
        if j < n && s.[j] = '}' then (Object [], j + 1) else fields (i + 1) [] []
      | '[' ->
        let rec items i found =
          let v, i = value (depth + 1) i in
          let i = skip i in
          if i < n && s.[i] = ',' then items (i + 1) (v :: found)
          else if i < n && s.[i] = ']' then (List (List.rev (v :: found)), i + 1)
          else bad i "a comma or ] must follow" in
        let j = skip (i + 1) in
        if j < n && s.[j] = ']' then (List [], j + 1) else items (i + 1) []
      | '"' -> let found, i = string (i + 1) in (String found, i)
      | 't' -> word i "true" (Bool true)
      | 'f' -> word i "false" (Bool false)
      | 'n' -> word i "null" Null
      | 'N' -> word i "NaN" (Number "NaN")
      | 'I' -> word i "Infinity" (Number "Infinity")
      | '-' when i + 1 < n && s.[i + 1] = 'I' -> word i "-Infinity" (Number "-Infinity")
      | _ -> number i in
  let v, i = value 0 0 in
  let i = skip i in
  if i < n then bad i "text follows the value" else v

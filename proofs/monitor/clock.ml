(* The time of an event in nanoseconds (docs/semantics.md, section 1.1), but for strptime formats. *)

open Rvaft_monitor

type format = Units of int * bool (* nanoseconds in one, and whether from 1601 *) | Iso | Ros

exception Refused of string

let format_of = function
  | "s" -> Units (1_000_000_000, false) | "ms" -> Units (1_000_000, false) | "us" -> Units (1_000, false)
  | "ns" -> Units (1, false) | "filetime" -> Units (100, true) | "iso8601" -> Iso | "ros" -> Ros
  | other -> raise (Refused
      (Printf.sprintf "the time format %s is not supported; supported: s ms us ns filetime iso8601 ros" other))

let rec positive_of n = if n = 1 then XH else if n land 1 = 1 then XI (positive_of (n lsr 1)) else XO (positive_of
    (n lsr 1))
let z n = if n = 0 then Z0 else if n > 0 then Zpos (positive_of n) else Zneg (positive_of (-n))
let ten = z 10
let power10 n = let rec go n acc = if n = 0 then acc else go (n - 1) (Z.mul acc ten) in go n (Zpos XH)

(* The integer that digits write. *)
let natural digits = String.fold_left (fun acc c -> Z.add (Z.mul acc ten) (z (Char.code c - 48))) Z0 digits

(* The integer nearest to a / b, half to even; b is positive. *)
let nearest a b =
  let q, r = Z.div_eucl a b in
  let twice = Z.mul r (z 2) in
  if Z.ltb twice b then q
  else if Z.ltb b twice then Z.add q (z 1)
  else let _, odd = Z.div_eucl q (z 2) in Z.add q odd

let offset_1601 = Z.mul (z 11_644_473_600) (z 1_000_000_000)

let limit = power10 31

(* A decimal as JSON writes it, times [units], rounded; numbers of 10^31 and more are undefined. *)
let decimal text units =
  let n = String.length text in
  let negative = n > 0 && text.[0] = '-' in
  let mark c = try String.index text c with Not_found -> n in
  let e = min (mark 'e') (mark 'E') in
  let point = min (mark '.') e in
  let start = if negative then 1 else 0 in
  let whole = String.sub text start (point - start) in
  let fraction = if point < e then String.sub text (point + 1) (e - point - 1) else "" in
  let digits = whole ^ fraction in
  let mantissa = natural digits in
  let exponent =
    if e >= n then Some 0
    else
      let written = String.sub text (e + 1) (n - e - 1) in
      let down = written.[0] = '-' in
      let body = if written.[0] = '-' || written.[0] = '+' then String.sub written 1 (String.length written - 1) else
          written in
      let rec strip i = if i < String.length body - 1 && body.[i] = '0' then strip (i + 1) else i in
      let body = let i = strip 0 in String.sub body i (String.length body - i) in
      if String.length body > 6 then if down then Some min_int else None
      else Some ((if down then -1 else 1) * int_of_string body) in
  if mantissa = Z0 then Some Z0
  else match exponent with
    | None -> None
    | Some x when x = min_int -> Some Z0
    | Some x ->
      let x = x - String.length fraction in
      if x + String.length digits > 2000 then None
      else if x + String.length digits < -2000 then Some Z0
      else
        let up, down = if x >= 0 then power10 x, Zpos XH else Zpos XH, power10 (-x) in
        if not (Z.ltb (Z.mul mantissa up) (Z.mul limit down)) then None
        else
          let signed = if negative then Z.opp mantissa else mantissa in
          Some (nearest (Z.mul (Z.mul signed up) (z units)) down)

let days_before year month day =       (* since 1970-01-01, proleptic Gregorian *)
  let y = if month <= 2 then year - 1 else year in
  let era = (if y >= 0 then y else y - 399) / 400 in
  let yoe = y - era * 400 in
  let doy = (153 * (month + (if month > 2 then -3 else 9)) + 2) / 5 + day - 1 in
  let doe = yoe * 365 + yoe / 4 - yoe / 100 + doy in
  era * 146_097 + doe - 719_468

let leap y = (y mod 4 = 0 && y mod 100 <> 0) || y mod 400 = 0
let days_in y m = match m with 2 -> if leap y then 29 else 28 | 4 | 6 | 9 | 11 -> 30 | _ -> 31

exception No_time

(* date, T or space, hours:minutes[:seconds[(.|,)decimals]], offset *)
let iso (s : string) =
  let n = String.length s in
  let at = ref 0 in
  let peek () = if !at < n then s.[!at] else '\000' in
  let next c = if peek () = c then incr at else raise No_time in
  let digit () = match peek () with '0' .. '9' as c -> incr at; Char.code c - 48 | _ -> raise No_time in
  let two () = let a = digit () in a * 10 + digit () in
  try
    let a = two () in
    let year = a * 100 + two () in
    next '-'; let month = two () in next '-'; let day = two () in
    (match peek () with 'T' | 't' | ' ' -> incr at | _ -> raise No_time);
    let hour = two () in next ':'; let minute = two () in
    let second = if peek () = ':' then (incr at; two ()) else 0 in
    let seconds_given = !at > 0 && n > 16 && s.[16] = ':' in
    let fraction =
      if seconds_given && (peek () = '.' || peek () = ',') then begin
        incr at;
        let from = !at in
        ignore (digit ());
        while (match peek () with '0' .. '9' -> true | _ -> false) do incr at done;
        String.sub s from (!at - from)
      end else "" in
    let offset = match peek () with
      | '\000' when !at >= n -> 0
      | 'Z' | 'z' -> incr at; 0
      | ('+' | '-') as sign ->
        incr at;
        let h = two () in
        let m = if !at < n then (if peek () = ':' then incr at; two ()) else 0 in
        if h > 23 || m > 59 then raise No_time;
        (if sign = '-' then -1 else 1) * (h * 60 + m)
      | _ -> raise No_time in
    if !at < n || year < 1 || month < 1 || month > 12 || day < 1 || day > days_in year month || hour > 23 ||
        minute > 59 || second > 60
    then raise No_time;
    let seconds = (days_before year month day * 86_400) + (hour * 3600) + ((minute - offset) * 60) + second in
    let nanoseconds = if fraction = "" then Z0 else
        nearest (Z.mul (natural fraction) (z 1_000_000_000))
          (power10 (String.length fraction)) in
    Some (Z.add (Z.mul (z seconds) (z 1_000_000_000)) nanoseconds)
  with No_time -> None

let integer_of = function
  | Json.Number text when String.for_all (fun c -> c = '-' || (c >= '0' && c <= '9')) text ->
    let n = String.length text in
    Some (if text.[0] = '-' then Z.opp (natural (String.sub text 1 (n - 1))) else natural text)
  | _ -> None

let is_number text = match Json.parse text with Json.Number ("NaN" | "Infinity" | "-Infinity") -> false
  | Json.Number found -> String.equal found text | _ -> false | exception Json.Bad _ -> false

let read format (value : Json.t) = match format, value with
  | Units (units, from_1601), (Json.Number _ | Json.String _) ->
    let text = match value with
      | Json.Number text -> text
      | Json.String points when List.length points <= 1000 && List.for_all (fun c -> c < 128) points ->
          Json.text_of points
      | _ -> "" in
    if not (is_number text) then None
    else Option.map (fun t -> if from_1601 then Z.sub t offset_1601 else t) (decimal text units)
  | Iso, Json.String points when List.length points <= 1000 && List.for_all (fun c -> c < 128) points -> iso
      (Json.text_of points)
  | Ros, Json.Object fields ->
    let last name = List.fold_left (fun found (n, v) -> if n = Json.points_of name then Some v else
        found) None fields in
    let pair s n = match Option.bind (last s) integer_of, Option.bind (last n) integer_of with
      | Some a, Some b -> Some (Z.add (Z.mul a (z 1_000_000_000)) b) | _ -> None in
    (match pair "sec" "nanosec" with Some t -> Some t | None -> pair "secs" "nsecs")
  | _ -> None

(* The value of a field, or of a path of fields. *)
let rec at path (value : Json.t) = match path, value with
  | [], _ -> Some value
  | name :: path, Json.Object fields ->
    Option.bind (List.fold_left (fun found (n, v) -> if n = name then Some v else found) None fields) (at path)
  | _ -> None

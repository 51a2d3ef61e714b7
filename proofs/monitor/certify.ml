(* Texts of LTLf, HOA and RML as JSON, which the extracted validator compares with a tree. *)

open Rvaft_monitor
open Tree_reader

type answer = Holds | Differs of string | Unknown of string

let rec variables p = match only p with
  | "variable", name -> [ text name ]
  | ("literal" | "any"), _ -> []
  | "object", Json.Object fields -> List.concat_map (fun (_, p) -> variables p) fields
  | "list", l -> List.concat_map variables (items l)
  | "some", p -> variables p
  | other, _ -> refuse "unknown pattern %s" other

(* A pattern and a condition with variables of their own. *)
let predicate lower v : predicate =
  let number = numbering () and shape = need "pattern" v in
  let arguments = List.map (fun x -> (x, Named (Rigid (number x)))) (variables shape) in
  (pattern number arguments shape,
   match need "condition" v with Json.Null -> [] | g -> [ guard lower number (fun _ -> None) g ])

(* The predicate with its variables numbered in their order; a variable that stands once is `_`. *)
let canonical ((p, guards) : predicate) : predicate =
  let known = Hashtbl.create 4 and uses = Hashtbl.create 4 in
  let use x = Hashtbl.replace uses x (1 + Option.value ~default:0 (Hashtbl.find_opt uses x)) in
  let number x = match Hashtbl.find_opt known x with
    | Some n -> n
    | None -> let n = Hashtbl.length known in Hashtbl.add known x n; n in
  let rec shape named = function
    | (Exactly _ | Anything) as p -> p
    | Named x -> named x
    | ObjectWith fields -> ObjectWith (List.map (fun (name, p) -> (name, shape named p)) fields)
    | ListOf l -> ListOf (List.map (shape named) l)
    | SomeItem p -> SomeItem (shape named p) in
  let rec condition value = function
    | (Constant _ | TimeOf _) as g -> g
    | ValueOf x -> value x
    | Apply (o, l) -> Apply (o, List.map (condition value) l)
    | AndThen (a, b) -> let a = condition value a in AndThen (a, condition value b)
    | OrElse (a, b) -> let a = condition value a in OrElse (a, condition value b) in
  ignore (shape (fun x -> use x; Anything) p);
  ignore (List.map (condition (fun x -> use (Rigid x); ValueOf x)) guards);
  let p = shape (fun x -> if Hashtbl.find uses x = 1 then Anything else Named (Rigid (number x))) p in
  (p, List.map (condition (fun x -> ValueOf (number (Rigid x)))) guards)

let word v = match items v with
  | Json.String w :: arguments -> (Json.text_of w, arguments)
  | _ -> refuse "a list that begins with a word was expected"

let rec joined make none = function [] -> none | [ x ] -> x | x :: l -> make x (joined make none l)

type 'a builder = { any : 'a; atom : int -> 'a; neg : 'a -> 'a; both : 'a -> 'a -> 'a; either : 'a -> 'a -> 'a;
    alive : 'a option }

(* A condition on an event: a Boolean formula over the predicates of the text, which are numbered from 0. *)
let rec condition b number v = match word v with
  | "predicate", [ n ] -> b.atom (number (Tree_reader.number n))
  | "not", [ c ] -> b.neg (condition b number c)
  | "and", l -> joined b.both b.any (List.map (condition b number) l)
  | "or", l -> joined b.either (b.neg b.any) (List.map (condition b number) l)
  | "alive", [] when b.alive <> None -> Option.get b.alive
  | other, _ -> refuse "unknown condition %s" other

let atoms = {
  any = Truth; atom = (fun n -> Atom n); neg = (fun f -> Neg f); both = (fun f g -> Conj (f, g));
  either = (fun f g -> Disj (f, g)); alive = None }
let labels = {
  any = AnyLetter; atom = (fun n -> Proposition n); neg = (fun l -> NotLabel l); both = (fun l m -> BothLabels (l, m));
  either = (fun l m -> EitherLabel (l, m)); alive = Some Alive }
let types = {
  any = AnyEvent; atom = (fun n -> Predicate n); neg = (fun t -> NotType t); both = (fun t u -> BothTypes (t, u));
  either = (fun t u -> EitherType (t, u)); alive = None }

(* Formulas as rows; operands are earlier rows, and the last row is the formula. *)
let formula number v =
  let rows = items v in
  let made = Array.make (List.length rows) Truth in
  List.iteri (fun i row ->
      let row_of n = let n = Tree_reader.number n in if n >= 0 && n < i then made.(n) else
          refuse "row %d uses row %d" i n in
      made.(i) <- (match word row with
          | "atom", [ c ] -> condition atoms number c
          | "not", [ n ] -> Neg (row_of n)
          | "and", l -> joined (fun f g -> Conj (f, g)) Truth (List.map row_of l)
          | "or", l -> joined (fun f g -> Disj (f, g)) Falsity (List.map row_of l)
          | "next", [ n ] -> Next (row_of n)
          | "eventually", [ n ] -> Eventually (row_of n)
          | "until", [ n; m ] -> Until (row_of n, row_of m)
          | other, _ -> refuse "unknown formula %s" other)) rows;
  if rows = [] then refuse "no formula" else made.(Array.length made - 1)

let automaton number v =
  let states = items (need "states" v) in
  let edge e = match items e with
    | [ c; target ] -> (condition labels number c, Tree_reader.number target)
    | _ -> refuse "an edge has a label and a target" in
  { start_state = Tree_reader.number (need "start" v); edges = List.map (fun s -> List.map edge (items
      (need "edges" s))) states;
    marks = List.map (fun s -> need "marked" s = Json.Bool true) states }

let rec term number v =
  let below make l = match List.map (term number) l with [] -> refuse "no operand" | l -> joined make Empty l in
  match word v with
  | "all", [] -> All
  | "empty", [] -> Empty
  | "event", [ c ] -> OfType (condition types number c)
  | "cat", l -> below (fun x y -> Concat (x, y)) l
  | "or", l -> below (fun x y -> Union (x, y)) l
  | "and", l -> below (fun x y -> Intersection (x, y)) l
  | "shuffle", l -> below (fun x y -> Shuffle (x, y)) l
  | "filter", [ c; x; y ] -> Filter (condition types number c, term number x, term number y)
  | "star", [ x ] -> Star (term number x)
  | "optional", [ x ] -> Optional (term number x)
  | "call", [ n ] -> Call (Tree_reader.number n)
  | other, _ -> refuse "unknown term %s" other

let most_letters = 20_000

(* Whether so many sets of predicates have no conflict that a comparison takes too long. *)
let too_many ps =
  let count = ref 0 in
  let rec go chosen = function
    | [] -> incr count; if !count > most_letters then raise Exit
    | k :: rest -> go chosen rest; if not (List.exists (conflict ps k) chosen) then go (k :: chosen) rest in
  match go [] (List.init (List.length ps + 1) Fun.id) with () -> false | exception Exit -> true

let mix a b = ((a * 1_000_003) lxor (b + (a lsr 17))) land max_int
let depth = 10_000

(* The answer for a text; [limit] bounds the pairs of a state of the text and a state of the automaton. *)
let certify read selection semantics limit v =
  let tree = read.tree in
  if tree.lateness <> None then refuse "the tree drops late events";
  let own = List.mapi (fun n name -> (name, predicate_of tree n)) read.names in
  let known = List.filter_map snd own @ relevance_entries tree in
  let given = List.map (predicate read.lower) (items (need "predicates" v)) in
  let found q = match List.find_opt (fun r -> same_predicate (canonical q) (canonical r)) known with Some r -> r
      | None -> q in
  let given = List.map found given in
  let ps = text_predicates tree given in
  if too_many ps then refuse "events can satisfy more than %d combinations of the predicates" most_letters;
  let place q = let rec go i = function
      | [] -> refuse "predicates with `lower` are not compared"
      | r :: rest -> if same_predicate q r then i else go (i + 1) rest in go 1 ps in
  let numbers = Array.of_list (List.map place given) in
  let number n = if n >= 0 && n < Array.length numbers then numbers.(n) else refuse "there is no predicate %d" n in
  let patterns = List.map (fun q -> fst (predicate read.lower q)) (items (need "samples" v)) @ List.map fst ps in
  let pairs = List.concat_map (fun p -> List.map (fun q -> match p, q with
      | ObjectWith f, ObjectWith g -> ObjectWith (f @ g) | _ -> p) patterns) patterns in
  let values = List.map sample (ObjectWith [] :: patterns @ pairs) in
  let body = need "text" v in
  let fuel = limit in
  let outcome = match text (need "language" v) with
    | "ltlf" -> certify_text_ltlf mix tree selection semantics ps values fuel (formula number body)
    | "automaton" -> certify_text_hoa mix tree selection semantics ps values fuel (automaton number body)
    | "rml" ->
      let equations = List.map (term number) (items body) in
      certify_text_rml mix tree selection semantics ps fuel depth equations (Call 0)
    | other -> refuse "unknown language %s" other in
  let satisfied = satisfies tree ps and all = List.init (List.length ps + 1) Fun.id in
  let is_object e = match e.content with Object _ -> true | _ -> false in
  let letters = lazy (List.map (letter_of satisfied all) (List.filter is_object (samples ps values))) in
  let named a =
    let nodes = List.filter_map (fun (name, q) -> match q with
        | Some q when List.mem (place q) a -> Some name | _ -> None) own in
    match nodes with
    | [] -> if List.mem 0 a then "(another relevant event)" else "(another event)"
    | nodes -> String.concat "+" nodes in
  match outcome with
  | Inr Certified -> Holds
  | Inr Exhausted -> Unknown (Printf.sprintf "the comparison ended at the limit of %d steps" limit)
  | Inr (Refuted found) ->
    let word = if found = [] then "the empty trace" else "the trace " ^ String.concat " " (List.map named found) in
    if List.for_all (fun a -> List.mem a (Lazy.force letters)) found then Differs ("the verdicts differ after " ^ word)
    else Unknown ("the verdicts differ after " ^ word ^ ", of which no example is known")
  | Inl NotWellFormed -> Unknown "the tree is not well formed"
  | Inl NotPlain -> Unknown "the tree has variables across nodes or conditions on time"
  | Inl NotListed -> Unknown "predicates with `lower` are not compared"
  | Inl NotServed -> Unknown "no event is known that some node accepts"

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

let of_formula = {
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
          | "atom", [ c ] -> condition of_formula number c
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

(* [event] and [filter] read the event types of events and of filters. *)
let rec term event filter v =
  let next = term event filter in
  let below make l = match List.map next l with [] -> refuse "no operand" | l -> joined make Empty l in
  match word v with
  | "all", [] -> All
  | "empty", [] -> Empty
  | "event", [ c ] -> OfType (event c)
  | "cat", l -> below (fun x y -> Concat (x, y)) l
  | "or", l -> below (fun x y -> Union (x, y)) l
  | "and", l -> below (fun x y -> Intersection (x, y)) l
  | "shuffle", l -> below (fun x y -> Shuffle (x, y)) l
  | "filter", [ c; x; y ] -> Filter (filter c, next x, next y)
  | "star", [ x ] -> Star (next x)
  | "optional", [ x ] -> Optional (next x)
  | "call", [ n ] -> Call (Tree_reader.number n)
  | other, _ -> refuse "unknown term %s" other

let most_letters = 20_000

(* The number of sets without a conflict. *)
let sets conflict numbers =
  let count = ref 0 in
  let rec go chosen = function
    | [] -> incr count; if !count > most_letters then
        refuse "events can satisfy more than %d combinations of the predicates" most_letters
    | k :: rest -> go chosen rest; if not (List.exists (conflict k) chosen) then go (k :: chosen) rest in
  go [] numbers;
  !count

let mix a b = ((a * 1_000_003) lxor (b + (a lsr 17))) land max_int
let depth = 10_000

(* What the comparison of any text needs: the tree, the part and the semantics, and events to name traces. *)
type task = { read : Tree_reader.t; selection : selection; semantics : semantics; limit : int; values : value list;
    predicates : Json.t list; body : Json.t }

let known_in task = List.filter_map (predicate_of task.read.tree) (List.init (List.length task.read.names) Fun.id)
    @ relevance_entries task.read.tree

(* The predicate of the tree that a predicate of the text is, up to the names of its variables. *)
let closed task v =
  let q = predicate task.read.lower v in
  match List.find_opt (fun r -> same_predicate (canonical q) (canonical r)) (known_in task) with Some r -> r | None -> q

let rec position same q from = function
  | [] -> refuse "predicates with `lower` are not compared"
  | r :: rest -> if same q r then from else position same q (from + 1) rest

let numbered numbers n = if n >= 0 && n < Array.length numbers then numbers.(n) else refuse "there is no predicate %d" n

let word_of named found = match found with
  | [] -> "the empty trace"
  | _ -> "the trace " ^ String.concat " " (List.map named found)

let answer limit refuted = function
  | Inr Certified -> Holds
  | Inr Exhausted -> Unknown (Printf.sprintf "the comparison ended at the limit of %d steps" limit)
  | Inr (Refuted found) -> refuted found
  | Inl NotWellFormed -> Unknown "the tree is not well formed"
  | Inl NotPlain -> Unknown "the tree has variables across nodes or conditions on time"
  | Inl NotTimed -> Unknown "the tree compares times by an operator that is not supported"
  | Inl NotListed -> Unknown "predicates with `lower` are not compared"
  | Inl NotServed -> Unknown "no event is known that some node accepts"
  | Inl NotDetermined -> Unknown "an event may give several values to a variable"
  | Inl NotBound -> Unknown "the text does not observe the events of some node"

let is_object e = match e.content with Object _ -> true | _ -> false
let name_letter nodes letter =
  let holds (_, numbers) = List.exists (fun k -> List.mem k letter) numbers in
  match List.map fst (List.filter holds nodes) with
  | [] -> if List.mem 0 letter then "(another relevant event)" else "(another event)"
  | names -> String.concat "+" names

(* A text of RML whose predicates have variables of their own. *)
let certify_plain task =
  let tree = task.read.tree in
  let given = List.map (closed task) task.predicates in
  let ps = text_predicates tree given in
  let all = List.init (List.length ps + 1) Fun.id in
  ignore (sets (conflict ps) all);
  let place q = position same_predicate q 1 ps in
  let number = numbered (Array.of_list (List.map place given)) in
  let test = condition types number in
  let equations = List.map (term test test) (items (need "equations" task.body)) in
  let events = List.map (fun v -> { content = v; time_of = None; late = false }) task.values in
  let letters = lazy (List.map (letter_of (satisfies tree ps) all) (List.filter is_object events)) in
  let nodes = List.mapi (fun n name -> (name, Option.to_list (Option.map place (predicate_of tree n))))
    task.read.names in
  answer task.limit (fun found ->
      let word = word_of (name_letter nodes) found in
      let known a = List.mem a (Lazy.force letters) in
      if List.for_all known found then Differs ("the verdicts differ after " ^ word)
      else Unknown ("the verdicts differ after " ^ word ^ ", of which no example is known"))
    (certify_text_rml mix tree task.selection task.semantics ps task.limit depth equations (Call 0))

(* A variable of a pattern that begins with `_` belongs to the event; one that stands once is `_`. *)
let canonical_locals p =
  let known = Hashtbl.create 4 and uses = Hashtbl.create 4 in
  let rec walk named = function
    | (Exactly _ | Anything | Named (Rigid _)) as p -> p
    | Named (Local x) -> named x
    | ObjectWith fields -> ObjectWith (List.map (fun (name, p) -> (name, walk named p)) fields)
    | ListOf l -> ListOf (List.map (walk named) l)
    | SomeItem p -> SomeItem (walk named p) in
  ignore (walk (fun x -> Hashtbl.replace uses x (1 + Option.value ~default:0 (Hashtbl.find_opt uses x)); Anything) p);
  let number = numbering_in known in
  walk (fun x -> if Hashtbl.find uses x = 1 then Anything else Named (Local (number x))) p

(* The operands of a minimum or maximum in one order. *)
let rec sorted g = match g with
  | Constant _ | ValueOf _ | TimeOf _ -> g
  | Apply ((Minimum | Maximum) as o, l) when List.for_all (function ValueOf _ -> true | _ -> false) l ->
    Apply (o, List.sort compare l)
  | Apply (o, l) -> Apply (o, List.map sorted l)
  | AndThen (a, b) -> AndThen (sorted a, sorted b)
  | OrElse (a, b) -> OrElse (sorted a, sorted b)

let is_atom v = field "guards" v <> None

(* The atoms of a text.  A variable is that of the tree of this name; the variable of a time is the clock of
   an occurrence with the pattern of the atom; others are new. *)
let atoms_of task =
  let tree = task.read.tree in
  let written = List.filter is_atom task.predicates in
  let clocks = Hashtbl.create 4 and others = Hashtbl.create 4 in
  let other = numbering_in others in
  let number x = match Hashtbl.find_opt clocks x, Hashtbl.find_opt task.read.variables x with
    | Some n, _ | None, Some n -> n
    | None, None -> 1_000_000_000 + other x in
  let local = numbering () in
  let pattern v =
    let shape = need "pattern" v in
    let name x = if x.[0] = '_' then Named (Local (local x)) else Named (Rigid (number x)) in
    canonical_locals (Tree_reader.pattern number (List.map (fun x -> (x, name x)) (variables shape)) shape) in
  let patterns = List.concat (List.mapi (fun n node -> match node.on with
      | Some p -> [ (n, node, p) ] | None -> []) tree.nodes) in
  let same p q = same_pattern (canonical_locals p) (canonical_locals q) in
  let own p = match List.find_opt (fun (_, _, q) -> same p q) patterns with Some (_, _, q) -> q | None -> p in
  let time v = optional text (need "time" v) in
  let timed = List.filter_map (fun v -> Option.map (fun x -> (x, v)) (time v)) written in
  let by_name (x, _) (y, _) = compare (String.length x, x) (String.length y, y) in
  let taken = ref [] in
  List.iter (fun (x, v) ->
      if not (Hashtbl.mem clocks x) then
        let p = pattern v in
        let occurrences = List.concat_map (fun (n, node, q) ->
            if same p q then List.init node.times (fun i -> (n, i)) else []) patterns in
        match List.find_opt (fun o -> not (List.mem o !taken)) occurrences with
        | Some o -> taken := o :: !taken; Hashtbl.replace clocks x (clock tree o)
        | None -> ()) (List.stable_sort by_name timed);
  let guards = List.concat (clocked_guards tree task.selection) in
  let guard v =
    let g = Tree_reader.guard task.read.lower number (fun _ -> None) v in
    match List.find_opt (fun h -> same_guard (sorted g) (sorted h)) guards with Some h -> h | None -> g in
  List.map (fun v ->
      { atom_pattern = own (pattern v); atom_time = Option.map number (time v);
        atom_guards = List.map guard (items (need "guards" v)) }) written

(* Values near those that guards and patterns name, to find a trace on which a text is wrong. *)
let rec constants g = match g with
  | Constant v -> [ v ]
  | ValueOf _ | TimeOf _ -> []
  | Apply (o, l) -> (match o with OneOf listed -> listed | _ -> []) @ List.concat_map constants l
  | AndThen (a, b) | OrElse (a, b) -> constants a @ constants b

let rec literals = function
  | Exactly v -> [ v ]
  | Named _ | Anything -> []
  | ObjectWith fields -> List.concat_map (fun (_, p) -> literals p) fields
  | ListOf l -> List.concat_map literals l
  | SomeItem p -> literals p

let rec filled value = function
  | Named (Rigid x) -> Exactly (value x)
  | (Exactly _ | Anything | Named (Local _)) as p -> p
  | ObjectWith fields -> ObjectWith (List.map (fun (name, p) -> (name, filled value p)) fields)
  | ListOf l -> ListOf (List.map (filled value) l)
  | SomeItem p -> SomeItem (filled value p)

let rec take n = function x :: l when n > 0 -> x :: take (n - 1) l | _ -> []
let once l = List.sort_uniq compare l
let near v = match v with
  | Num { mantissa; scale = N0 } -> [ v; integer (Z.add mantissa (Zpos XH)); integer (Z.sub mantissa (Zpos XH)) ]
  | _ -> [ v ]

(* Events that match the patterns of atoms, at different times where atoms name these. *)
let trial_events qs values =
  let named = once (List.concat_map (fun q -> List.concat_map constants q.atom_guards) qs) in
  let pool = take 20 (once (List.concat_map near (named @ List.concat_map (fun q -> literals q.atom_pattern) qs))) in
  let rec assignments = function
    | [] -> [ [] ]
    | x :: rest -> let l = assignments rest in List.concat_map (fun v -> List.map (List.cons (x, v)) l) pool in
  let instances p = let xs = once (pattern_variables p) in
    List.map (fun l -> sample (filled (fun x -> List.assoc x l) p)) (take 400 (assignments (take 2 xs)
        |> List.map (fun l -> l @ List.map (fun x -> (x, Null)) xs))) in
  let patterns = once (List.map (fun q -> q.atom_pattern) qs) in
  let contents = once (List.concat_map instances patterns @ values) in
  let times = if List.for_all (fun q -> q.atom_time = None) qs then [ Z0 ] else
      take 6 (once (Z0 :: List.concat_map (function Num { mantissa; scale = N0 } ->
          [ mantissa; Z.add mantissa (Zpos XH) ] | _ -> []) named)) in
  List.concat_map (fun z -> List.filter_map (function
      | Object _ as v -> Some { content = v; time_of = Some z; late = false } | _ -> None) contents) times

(* Refuse predicates and atoms of which events can satisfy too many combinations. *)
let bounded_letters tree ps basic composed =
  ignore (sets (conflict ps) (List.init (List.length ps + 1) Fun.id));
  let letters_beside a =
    sets (atoms_conflict ps basic composed) (allowed (pattern_numbers ps basic composed) a (basic_numbers ps basic)) in
  if List.fold_left (fun n a -> n + letters_beside a) 0 (related_letters tree ps) > 10 * most_letters then
    refuse "events can satisfy more than %d combinations of the predicates" most_letters

let most_slices = 50_000

(* A text of LTLf or HOA over its slices. [use numbers] has the predicates of the text, whether it accepts a
   word of letters (None when this is not decided), and its comparison with the tree. *)
let certify_slices task use =
  let tree = task.read.tree in
  let atoms = atoms_of task in
  let given = List.map (closed task) (List.filter (fun v -> not (is_atom v)) task.predicates) in
  let basic, composed = slice_atoms tree task.selection atoms in
  let qs = basic @ composed in
  let ps = slice_predicates tree given qs in
  bounded_letters tree ps basic composed;
  let number q = atom_number ps qs q in
  let rec numbers predicates given atoms = match predicates, given, atoms with
    | [], _, _ -> []
    | v :: rest, _, q :: atoms when is_atom v -> number q :: numbers rest given atoms
    | _ :: rest, q :: given, _ -> position same_predicate q 1 ps :: numbers rest given atoms
    | _ -> assert false in
  let names, accepts, certified = use (numbered (Array.of_list (numbers task.predicates given atoms))) in
  let values = task.values @ List.map (fun q -> sample q.atom_pattern) qs in
  let wanted = alphabet0 (slice_shapes tree ps qs task.selection) @ names in
  let satisfied = slice_satisfies tree ps qs in
  let letter = letter_of satisfied (List.filter (fun k -> List.mem k wanted) (all_numbers ps basic composed)) in
  (* Whether an event may have any time: its content says nothing about the field of times. *)
  let any_time e = match e.content, Option.map (fun t -> items (need "field" t)) task.read.time with
    | Object fields, Some (Json.String name :: _) -> not (List.mem_assoc name fields)
    | _ -> true in
  let timed = List.exists (fun q -> q.atom_time <> None) qs in
  let events = lazy (List.filter (fun e -> not timed || any_time e) (trial_events qs task.values)) in
  (* The assignments after an event. *)
  let after e b = b :: List.concat_map (fun q -> List.filter_map (fun bs ->
      let own = assigned_by q e bs in
      let later x = match b x with Some v -> Some v | None -> own x in
      if observes q (e, later) then Some later else None) (bindings q.atom_pattern e.content)) atoms in
  let budget = ref 0 in
  let within_budget f = budget := most_slices; try f () with Exit -> None in
  let left () = decr budget; if !budget < 0 then raise Exit in
  let unbound _ = None in
  let begin_ = ([ ([], unbound) ], first tree task.selection) and step = next tree task.semantics in
  (* The slices after an event, each with its letters, and the state of the monitor. *)
  let advance (slices, state) e =
    (List.concat_map (fun (word, b) -> List.map (fun b -> left (); (letter (e, b) :: word, b)) (after e b)) slices,
     step state e) in
  (* Whether the text accepts a trace, if this is known and the tree says otherwise. *)
  let wrong (slices, state) =
    let answers = List.map (fun (word, _) -> accepts (List.rev word)) slices in
    let accepted = if List.mem (Some true) answers then Some true else if List.mem None answers then None
      else Some false in
    if accepted = Some (verdict_after state = Top) then None else accepted in
  (* A trace with a slice of these letters. *)
  let rec trace_of b = function
    | [] -> Some []
    | a :: rest -> List.find_map (fun e -> List.find_map (fun b -> left ();
        if letter (e, b) = a then Option.map (List.cons e) (trace_of b rest) else None) (after e b))
        (Lazy.force events) in
  let checked u = Option.map (fun accepted -> (u, accepted)) (wrong (List.fold_left advance begin_ u)) in
  (* A trace of some length on which the text is wrong. *)
  let rec search now u length =
    if length = 0 then Option.map (fun accepted -> (List.rev u, accepted)) (wrong now)
    else List.find_map (fun e -> search (advance now e) (e :: u) (length - 1)) (Lazy.force events) in
  let example found =
    match within_budget (fun () -> Option.bind (trace_of unbound found) checked) with
    | Some _ as example -> example
    | None -> within_budget (fun () -> List.find_map (search begin_ []) (List.init (1 + List.length found) Fun.id)) in
  let matched e =
    match List.concat (List.map2 (fun name node -> match node.on with
        | Some p when bindings p e.content <> [] -> [ name ] | _ -> []) task.read.names tree.nodes) with
    | [] -> "(another event)"
    | names -> String.concat "+" names in
  answer task.limit (fun found -> match example found with
      | Some (u, true) -> Differs ("the text accepts " ^ word_of matched u ^ ", in which the tree detects nothing")
      | Some (u, false) -> Differs ("the text does not accept " ^ word_of matched u ^ ", in which the tree detects")
      | None -> Unknown "the text may differ from the tree; no trace is known on which it does")
    (certified task.selection task.semantics ps basic composed atoms values task.limit)

let certify_ltlf task = certify_slices task (fun number ->
    let f = formula number task.body in
    (atoms f, (fun word -> Some (at_end (List.fold_left derivative (simplified f) word))),
     fun w s ps basic composed atoms values fuel ->
       certify_text_ltlf mix task.read.tree w s ps basic composed atoms values fuel f))

let certify_hoa task = certify_slices task (fun number ->
    let h = automaton number task.body in
    let state_after word = List.fold_left (hoa_step h) (Standing (Some h.start_state)) word in
    (hoa_atoms h, (fun word -> hoa_accepts h (state_after word)),
     fun w s ps basic composed atoms values fuel ->
       certify_text_hoa mix task.read.tree w s ps basic composed atoms values fuel h))

(* What the local variables of a pattern are in a pattern of the tree, if both are the same: different variables
   that the text does not follow. *)
let rec unified shared known p q = match p, q with
  | (Named (Local _) | Anything), Named (Rigid x) when not (List.mem x shared) ->
    let name = match p with Named (Local l) -> l | _ -> -1 in
    (match List.assoc_opt name known with
     | Some y when name >= 0 -> if x = y then Some known else None
     | _ -> if List.exists (fun (_, y) -> x = y) known then None else Some ((name, x) :: known))
  | ObjectWith f, ObjectWith g when List.map fst f = List.map fst g ->
    List.fold_left2 (fun known (_, p) (_, q) -> Option.bind known (fun known -> unified shared known p q))
      (Some known) f g
  | ListOf l, ListOf m when List.length l = List.length m ->
    List.fold_left2 (fun known p q -> Option.bind known (fun known -> unified shared known p q)) (Some known) l m
  | SomeItem p, SomeItem q -> unified shared known p q
  | _ -> if same_pattern p q then Some known else None

let rec conjuncts = function AndThen (a, b) -> conjuncts a @ conjuncts b | g -> [ g ]

(* The atom of a predicate; [shared] has the variables of the block.  Other variables are those of a pattern of the
   tree, where the tree has this pattern, and else are new. *)
let atom_in task shared fresh v =
  let locals = numbering () in
  let shape = need "pattern" v in
  let name x = match List.assoc_opt x shared with Some n -> Named (Rigid n) | None -> Named (Local (locals x)) in
  let p = Tree_reader.pattern locals (List.map (fun x -> (x, name x)) (variables shape)) shape in
  let tree_guards = List.concat (clocked_guards task.read.tree task.selection) in
  let of_tree g = List.find_opt (fun h -> same_guard (sorted g) (sorted h)) tree_guards in
  let guards number = match need "condition" v with
    | Json.Null -> []
    | g -> let g = guard task.read.lower number (fun _ -> None) g in
      (match of_tree g with Some h -> [ h ] | None ->
         List.map (fun g -> Option.value (of_tree g) ~default:g) (conjuncts g)) in
  let made pattern number = { atom_pattern = pattern; atom_time = None; atom_guards = guards number } in
  let number known x = match List.assoc_opt x shared with Some n -> n | None ->
    Option.value (List.assoc_opt (locals x) known) ~default:(fresh x) in
  let candidates = List.filter_map (fun node -> Option.bind node.on (fun q ->
      Option.map (fun known -> made q (number known)) (unified (List.map snd shared) [] p q))) task.read.tree.nodes in
  let known_guards q = List.for_all (fun g -> of_tree g <> None) q.atom_guards in
  match List.find_opt known_guards candidates, candidates with
  | Some q, _ | None, q :: _ -> q
  | None, [] ->
    let asked = match need "condition" v with Json.Null -> [] | _ -> variables shape in
    let name x = if List.mem_assoc x shared || not (List.mem x asked) then name x else Named (Rigid (fresh x)) in
    made (canonical_locals (Tree_reader.pattern locals (List.map (fun x -> (x, name x)) (variables shape)) shape))
      (number [])

(* A text of RML over the values of the variables of its block.  Its events are atoms; filters, and negations without
   variables of the block, have predicates with variables of their own. *)
let certify_block task =
  let tree = task.read.tree in
  let new_variables = ref 1_000_000_000 in
  let fresh _ = incr new_variables; !new_variables in
  let names = List.map text (items (need "variables" task.body)) in
  let shared = List.map (fun x -> (x, match Hashtbl.find_opt task.read.variables (String.capitalize_ascii x) with
      | Some n -> n | None -> fresh x)) names in
  if List.length (once names) < List.length names || List.length (once (List.map snd shared)) < List.length names then
    refuse "two variables of the block are alike";
  let written = Array.of_list task.predicates in
  let follows v = List.exists (fun x -> List.mem_assoc x shared) (variables (need "pattern" v)) in
  let atoms = Array.map (fun v -> let known = Hashtbl.create 4 in
      lazy (atom_in task shared (fun x -> match Hashtbl.find_opt known x with
          | Some n -> n | None -> let n = fresh x in Hashtbl.add known x n; n) v)) written in
  let closed_ones = Array.map (fun v -> lazy (if follows v then refuse "a filter has variables of the block" else
      closed task v)) written in
  (* The event types with numbers for atoms and for predicates with variables of their own. *)
  let equations atom own =
    let rec test positive v = match word v with
      | "not", [ c ] -> NotType (test (fun n -> if follows written.(n) then atom n else own n) c)
      | "or", l -> joined (fun t u -> EitherType (t, u)) NoEvent (List.map (test positive) l)
      | _ -> condition types (fun n -> positive (numbered (Array.init (Array.length written) Fun.id) n)) v in
    List.map (term (test atom) (test own)) (items (need "equations" task.body)) in
  let used = ref [] and given = ref [] in
  ignore (equations (fun n -> used := Lazy.force atoms.(n) :: !used; 0)
      (fun n -> given := Lazy.force closed_ones.(n) :: !given; 0));
  let basic, composed = slice_atoms tree task.selection !used in
  let qs = basic @ composed in
  let ps = slice_predicates tree !given qs in
  bounded_letters tree ps basic composed;
  let equations = equations (fun n -> atom_number ps qs (Lazy.force atoms.(n)))
      (fun n -> position same_predicate (Lazy.force closed_ones.(n)) 1 ps) in
  answer task.limit (fun found ->
      Unknown (Printf.sprintf "the verdicts may differ after %d events" (List.length found)))
    (certify_text_block mix tree task.selection task.semantics ps basic composed (List.map snd shared) depth equations
       task.limit (Call 0))

let certify_rml task =
  match if items (need "variables" task.body) = [] then certify_plain task else Unknown "" with
  | Unknown _ -> certify_block task
  | decided -> decided

(* The answer for a text; [limit] bounds the pairs of a state of the text and a state of the automaton. *)
let certify read selection semantics limit v =
  if not (no_absences read.tree) then refuse "absent events (`without`) are not certified";
  if not (basic read.tree) then refuse "values of each event (`distinct`, `each`) are not certified";
  if read.tree.lateness <> None && need "in_order" v <> Json.Bool true then refuse "the tree drops late events";
  let predicates = items (need "predicates" v) in
  let reads_time v = Option.fold ~none:false ~some:((<>) Json.Null) (field "time" v) in
  let same_time t u = need "field" t = need "field" u && need "format" t = need "format" u in
  (match optional Fun.id (need "time" v), read.time with
   | None, _ -> if List.exists reads_time predicates then refuse "the text does not say where events have their time"
   | Some t, Some u when same_time t u -> ()
   | Some _, _ -> refuse "the text has another time than the tree");
  let task = { read; selection; semantics; limit; values = []; predicates; body = need "text" v } in
  let patterns = List.map (fun q -> fst (predicate read.lower q)) (items (need "samples" v))
      @ List.map fst (known_in task)
      @ List.filter_map (fun v -> if is_atom v then None else Some (fst (closed task v))) predicates in
  let pairs = List.concat_map (fun p -> List.map (fun q -> match p, q with
      | ObjectWith f, ObjectWith g -> ObjectWith (f @ g) | _ -> p) patterns) patterns in
  let task = { task with values = List.map sample (ObjectWith [] :: patterns @ pairs) } in
  match text (need "language" v) with
  | "ltlf" -> certify_ltlf task
  | "automaton" -> certify_hoa task
  | "rml" -> certify_rml task
  | other -> refuse "unknown language %s" other

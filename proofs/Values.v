(** * Values: JSON with equality by value, order, and the operators of guards

    Section 1 of [docs/semantics.md].  A value is kept in a normal form, in which equality by value
    is equality: a number is an integer or a binary fraction with an odd numerator, and the fields
    of an object are sorted by name.  [object] and [binary] make normal forms. *)

Require Import List Bool Arith ZArith Lia.
Require Import Floats.SpecFloat.
Import ListNotations.
Local Open Scope Z_scope.

(** A text is a list of code points. *)
Definition text := list nat.

(** The number [mantissa * 2^-scale].  In the normal form the scale is 0 or the mantissa is odd. *)
Record number := Number { mantissa : Z; scale : N }.

Inductive value :=
| Null
| Bool (b : bool)
| Num (n : number)
| Text (s : text)
| List (items : list value)
| Object (fields : list (text * value))
| Undefined (number : nat).
(** [Undefined] is NaN or an infinity, which JSON does not have.  A reader gives each one in a log a
    number of its own, so that it equals no other value. *)

Definition integer (z : Z) : value := Num (Number z 0).

(** A value without NaN and infinities. *)
Fixpoint defined (v : value) : bool :=
  match v with
  | Null | Bool _ | Num _ | Text _ => true
  | List l => forallb defined l
  | Object f => forallb (fun field => defined (snd field)) f
  | Undefined _ => false
  end.

(** ** Normal forms *)

Fixpoint halve (fuel : nat) (m : Z) (s : N) : number :=
  match fuel with
  | O => Number m s
  | S fuel =>
    if N.eqb s 0 then Number m 0
    else if Z.even m then halve fuel (Z.div2 m) (N.pred s) else Number m s
  end.

(** The number [m * 2^e]. *)
Definition binary (m e : Z) : number :=
  if Z.leb 0 e then Number (m * 2 ^ e) 0
  else if Z.eqb m 0 then Number 0 0
  else halve (Z.to_nat (Z.opp e)) m (Z.to_N (Z.opp e)).

(** The order of texts: lexicographic, by code points. *)
Fixpoint compare_text (s t : text) : comparison :=
  match s, t with
  | [], [] => Eq
  | [], _ => Lt
  | _, [] => Gt
  | a :: s, b :: t => match Nat.compare a b with Eq => compare_text s t | c => c end
  end.

Fixpoint insert_field (name : text) (v : value) (fields : list (text * value)) :=
  match fields with
  | [] => [(name, v)]
  | (other, w) :: rest =>
    match compare_text name other with
    | Lt => (name, v) :: fields
    | Eq => (name, v) :: rest
    | Gt => (other, w) :: insert_field name v rest
    end
  end.

(** An object; of several fields with one name the last counts, as JSON readers have it. *)
Definition object (fields : list (text * value)) : value :=
  Object (fold_left (fun made field => insert_field (fst field) (snd field) made) fields []).

(** ** Equality *)

Definition text_eqb : text -> text -> bool :=
  fix equal s t :=
    match s, t with
    | [], [] => true
    | a :: s, b :: t => Nat.eqb a b && equal s t
    | _, _ => false
    end.

Definition number_eqb (a b : number) : bool := Z.eqb (mantissa a) (mantissa b) && N.eqb (scale a) (scale b).

Fixpoint value_eqb (v w : value) : bool :=
  match v, w with
  | Null, Null => true
  | Bool a, Bool b => Bool.eqb a b
  | Num a, Num b => number_eqb a b
  | Text s, Text t => text_eqb s t
  | List l, List m =>
    (fix items l m :=
       match l, m with
       | [], [] => true
       | v :: l, w :: m => value_eqb v w && items l m
       | _, _ => false
       end) l m
  | Object f, Object g =>
    (fix fields f g :=
       match f, g with
       | [], [] => true
       | (a, v) :: f, (b, w) :: g => text_eqb a b && value_eqb v w && fields f g
       | _, _ => false
       end) f g
  | Undefined a, Undefined b => Nat.eqb a b
  | _, _ => false
  end.

Lemma text_eqb_iff : forall s t, text_eqb s t = true <-> s = t.
Proof.
  induction s as [| a s IH]; destruct t as [| b t]; simpl; try (split; congruence).
  rewrite andb_true_iff, Nat.eqb_eq, IH. split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

Lemma number_eqb_iff : forall a b, number_eqb a b = true <-> a = b.
Proof.
  intros [m s] [m' s']; unfold number_eqb; simpl. rewrite andb_true_iff, Z.eqb_eq, N.eqb_eq.
  split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

(** Induction over values, with the items of lists and the fields of objects. *)
Section ValueInduction.
Variable P : value -> Prop.
Hypothesis on_null : P Null.
Hypothesis on_bool : forall b, P (Bool b).
Hypothesis on_num : forall n, P (Num n).
Hypothesis on_text : forall s, P (Text s).
Hypothesis on_list : forall l, Forall P l -> P (List l).
Hypothesis on_object : forall f, Forall (fun field => P (snd field)) f -> P (Object f).
Hypothesis on_undefined : forall n, P (Undefined n).
Fixpoint value_induction (v : value) : P v :=
  match v with
  | Null => on_null
  | Bool b => on_bool b
  | Num n => on_num n
  | Text s => on_text s
  | List l => on_list l
      ((fix all l := match l return Forall P l with
                     | [] => Forall_nil _
                     | v :: l => Forall_cons _ (value_induction v) (all l) end) l)
  | Object f => on_object f
      ((fix all f := match f return Forall (fun field => P (snd field)) f with
                     | [] => Forall_nil _
                     | field :: f => Forall_cons _ (value_induction (snd field)) (all f) end) f)
  | Undefined n => on_undefined n
  end.
End ValueInduction.

Theorem value_eqb_iff : forall v w, value_eqb v w = true <-> v = w.
Proof.
  induction v as [| b | n | s | l IH | f IH | k] using value_induction; destruct w as [| b' | n' | s' | l' | f' | k'];
    simpl; try (split; congruence).
  - destruct b, b'; simpl; split; congruence.
  - rewrite number_eqb_iff. split; congruence.
  - rewrite text_eqb_iff. split; congruence.
  - revert l'; induction IH as [| v l Hv _ IHl]; destruct l' as [| w l']; try (split; congruence).
    rewrite andb_true_iff, Hv, IHl.
    split; [intros [-> H]; injection H as ->; auto | intros H; injection H as -> ->; auto].
  - revert f'; induction IH as [| [a v] f Hv _ IHf]; destruct f' as [| [b w] f']; try (split; congruence).
    simpl in Hv. rewrite !andb_true_iff, text_eqb_iff, Hv, IHf.
    split; [intros [[-> ->] H]; injection H as ->; auto | intros H; injection H as -> -> ->; auto].
  - rewrite Nat.eqb_eq. split; congruence.
Qed.

(** ** The order of numbers, and arithmetic *)

Definition compare_numbers (a b : number) : comparison :=
  Z.compare (mantissa a * 2 ^ Z.of_N (scale b)) (mantissa b * 2 ^ Z.of_N (scale a)).

(** IEEE doubles by Coq's executable specification of floating-point numbers. *)
Definition precision := 53.
Definition exponents := 1024.

Definition to_double (a : number) : option spec_float :=
  match binary_normalize precision exponents (mantissa a) (Z.opp (Z.of_N (scale a))) false with
  | S754_zero s => Some (S754_zero s)
  | S754_finite s m e => Some (S754_finite s m e)
  | _ => None
  end.

Definition of_double (x : spec_float) : option number :=
  match x with
  | S754_zero _ => Some (Number 0 0)
  | S754_finite s m e => Some (binary (if s then Zneg m else Zpos m) e)
  | _ => None
  end.

Definition is_integer (a : number) : bool := N.eqb (scale a) 0.

(** Integers are exact; otherwise operands and result are rounded to doubles. *)
Definition arithmetic (exact : Z -> Z -> Z) (rounded : spec_float -> spec_float -> spec_float) (a b : number)
  : option number :=
  if is_integer a && is_integer b then Some (Number (exact (mantissa a) (mantissa b)) 0)
  else match to_double a, to_double b with
       | Some x, Some y => of_double (rounded x y)
       | _, _ => None
       end.

(** The double nearest to [a / b], for positive integers of any size. *)
Definition nearest_quotient (negative : bool) (a b : positive) : spec_float :=
  let '(m, e, l) := SFdiv_core_binary precision exponents (Zpos a) 0 (Zpos b) 0 in
  binary_round_aux precision exponents negative m e l.

Definition divide (a b : number) : option number :=
  if Z.eqb (mantissa b) 0 then None
  else if is_integer a && is_integer b then
    match mantissa a, mantissa b with
    | Zpos p, Zpos q | Zneg p, Zneg q => of_double (nearest_quotient false p q)
    | Zpos p, Zneg q | Zneg p, Zpos q => of_double (nearest_quotient true p q)
    | _, _ => Some (Number 0 0)
    end
  else match to_double a, to_double b with
       | Some x, Some y => of_double (SFdiv precision exponents x y)
       | _, _ => None
       end.

Definition negate (a : number) : number := Number (Z.opp (mantissa a)) (scale a).
Definition absolute (a : number) : number := Number (Z.abs (mantissa a)) (scale a).
Definition smaller (a b : number) : number := match compare_numbers b a with Lt => b | _ => a end.
Definition greater (a b : number) : number := match compare_numbers b a with Gt => b | _ => a end.

(** ** Numbers as JSON writes them *)

Definition is_digit (c : nat) : bool := Nat.leb 48 c && Nat.leb c 57.

(** The digits at the beginning of a text: their value, their number, and the rest. *)
Fixpoint digits (s : text) (so_far : Z) (count : Z) : Z * Z * text :=
  match s with
  | c :: rest => if is_digit c then digits rest (so_far * 10 + Z.of_nat (c - 48)) (count + 1)
                 else (so_far, count, s)
  | [] => (so_far, count, [])
  end.

(** The number [m * 10^e] as a reader of JSON has it: rounded to a double. *)
Definition decimal (negative : bool) (m e : Z) : option number :=
  match m with
  | Zpos p =>
    let size := e + Z.log2 m * 30103 / 100000 in          (* the power of ten of the number, or nearly *)
    if Z.ltb 400 size then None
    else if Z.ltb size (-400) then Some (Number 0 0)
    else if Z.leb 0 e
         then of_double (binary_normalize precision exponents
                           ((if negative then -1 else 1) * (m * 10 ^ e)) 0 false)
         else match 10 ^ Z.opp e with
              | Zpos q => of_double (nearest_quotient negative p q)
              | _ => None
              end
  | _ => Some (Number 0 0)
  end.

(** The rest of a text that begins with this code point. *)
Definition after (code : nat) (s : text) : option text :=
  match s with c :: rest => if Nat.eqb c code then Some rest else None | [] => None end.

Definition minus := 45%nat.
Definition plus := 43%nat.
Definition dot := 46%nat.
Definition zero := 48%nat.

(** [-?(0|[1-9][0-9]* )([.][0-9]+)?([eE][+-]?[0-9]+)?]; without fraction and exponent an integer. *)
Definition parse_number (s : text) : option number :=
  let '(negative, s) := match after minus s with Some rest => (true, rest) | None => (false, s) end in
  let '(whole, count, rest) := digits s 0 0 in
  let leading_zero := match after zero s with Some _ => true | None => false end in
  if Z.eqb count 0 || (leading_zero && negb (Z.eqb count 1)) then None
  else
    let '(m, places, rest, good) :=
      match after dot rest with
      | Some tail => let '(m, c, r) := digits tail whole 0 in (m, c, r, negb (Z.eqb c 0))
      | None => (whole, 0, rest, true)
      end in
    if negb good then None
    else match rest with
         | [] => if Z.eqb places 0
                 then Some (Number (if negative then Z.opp whole else whole) 0)
                 else decimal negative m (Z.opp places)
         | c :: tail =>
           if Nat.eqb c 101 || Nat.eqb c 69 then
             let '(down, tail) :=
               match after minus tail, after plus tail with
               | Some r, _ => (true, r)
               | None, Some r => (false, r)
               | None, None => (false, tail)
               end in
             let '(x, c, r) := digits tail 0 0 in
             match r with
             | [] => if Z.eqb c 0 then None
                     else decimal negative m ((if down then Z.opp x else x) - places)
             | _ => None
             end
           else None
         end.

(** ** Texts *)

Fixpoint starts_with (s prefix : text) : bool :=
  match prefix, s with
  | [], _ => true
  | p :: prefix, c :: s => Nat.eqb p c && starts_with s prefix
  | _, [] => false
  end.

Definition ends_with (s suffix : text) : bool := starts_with (rev s) (rev suffix).

Fixpoint contains (s part : text) : bool :=
  starts_with s part || match s with [] => false | _ :: s => contains s part end.

(** Whether a glob matches each suffix of a text, from the whole text to the empty one. *)
Fixpoint glob_rows (glob : text) (s : text) : list bool :=
  match glob with
  | [] => map (fun _ => false) s ++ [true]
  | g :: glob =>
    let next := glob_rows glob s in
    if Nat.eqb g 42 then                                                 (* a star *)
      fold_right (fun b later => (b || hd false later) :: later) [] next
    else
      (fix each s next := match s, next with
         | c :: s, _ :: ((b :: _) as next) => ((Nat.eqb g 63 || Nat.eqb g c) && b) :: each s next
         | _, _ => [false]
         end) s next
  end.

Definition like (s glob : text) : bool := hd false (glob_rows glob s).

(** ** The operators of guards, except [and] and [or] *)

Inductive operator :=
| Equals | Differs | Less | LessOrEqual | Greater | GreaterOrEqual
| Add | Subtract | Multiply | Divide | Negate | Not
| OneOf (listed : list value)
| StartsWith | EndsWith | Contains | Like
| Lower (lower : nat -> text)              (* each character for itself, by a table of Unicode *)
| Absolute | Minimum | Maximum | ToNumber.

Definition ordered (holds : comparison -> bool) (v w : value) : option value :=
  match v, w with
  | Num a, Num b => Some (Bool (holds (compare_numbers a b)))
  | Text s, Text t => Some (Bool (holds (compare_text s t)))
  | _, _ => None
  end.

Definition numeric (f : number -> number -> option number) (v w : value) : option value :=
  match v, w with Num a, Num b => option_map Num (f a b) | _, _ => None end.

Definition textual (f : text -> text -> bool) (v w : value) : option value :=
  match v, w with Text s, Text t => Some (Bool (f s t)) | _, _ => None end.

Fixpoint extreme (choose : number -> number -> number) (best : number) (l : list value) : option value :=
  match l with
  | [] => Some (Num best)
  | Num a :: l => extreme choose (choose best a) l
  | _ => None
  end.

(** The value of an operator; [None] is undefined. *)
Definition apply (o : operator) (operands : list value) : option value :=
  if negb (forallb defined operands) then None else
  match o, operands with
  | Equals, [v; w] => Some (Bool (value_eqb v w))
  | Differs, [v; w] => Some (Bool (negb (value_eqb v w)))
  | Less, [v; w] => ordered (fun c => match c with Lt => true | _ => false end) v w
  | LessOrEqual, [v; w] => ordered (fun c => match c with Gt => false | _ => true end) v w
  | Greater, [v; w] => ordered (fun c => match c with Gt => true | _ => false end) v w
  | GreaterOrEqual, [v; w] => ordered (fun c => match c with Lt => false | _ => true end) v w
  | Add, [v; w] => numeric (arithmetic Z.add (SFadd precision exponents)) v w
  | Subtract, [v; w] => numeric (arithmetic Z.sub (SFsub precision exponents)) v w
  | Multiply, [v; w] => numeric (arithmetic Z.mul (SFmul precision exponents)) v w
  | Divide, [v; w] => numeric divide v w
  | Negate, [Num a] => Some (Num (negate a))
  | Not, [Bool b] => Some (Bool (negb b))
  | OneOf listed, [v] => Some (Bool (existsb (value_eqb v) listed))
  | StartsWith, [v; w] => textual starts_with v w
  | EndsWith, [v; w] => textual ends_with v w
  | Contains, [v; w] => textual contains v w
  | Like, [v; w] => textual like v w
  | Lower lower, [Text s] => Some (Text (flat_map lower s))
  | Absolute, [Num a] => Some (Num (absolute a))
  | Minimum, Num a :: l => extreme smaller a l
  | Maximum, Num a :: l => extreme greater a l
  | ToNumber, [Num a] => Some (Num a)
  | ToNumber, [Text s] => option_map Num (parse_number s)
  | _, _ => None
  end.

(** * Absent events of a tree (section 1.5) as Boolean tests

    What breaks a partial match, and what decides a complete one, is computed from the trace and the
    positions of its events.  [unbroken_iff] and [decided_iff]: the tests are those of the definition;
    [absence_watchable]: they have the laws that the search needs. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios
  RVAFT.Waiting.
Import ListNotations.

Lemma and_iff : forall A B C D, (A <-> B) -> (C <-> D) -> (A /\ C <-> B /\ D).
Proof. tauto. Qed.

(** ** Less of a trace, and of an assignment *)

Section Less.
Variable t : tree.
Variable r : resolution.
Variable part : nat -> list occurrence.
Hypothesis part_iff : forall n o, In o (part n) <-> InPart t r n o.
Variables h h' : list event.
Variables position position' : occurrence -> nat.
Variables m m' : assigned event.
Hypothesis less_trace : forall i e, nth_error h i = Some e -> nth_error h' i = Some e.
Hypothesis less_assigned : incl m m'.
Hypothesis once' : NoDup (domain m').
Hypothesis others_later : forall o, In o (domain m') -> In o (domain m) \/ length h <= position' o.
Hypothesis same_positions : forall o, In o (domain m) -> position o = position' o.

Lemma less_domain : incl (domain m) (domain m').
Proof. intros o I. apply in_domain in I as [e I]. apply in_domain. eauto. Qed.

Lemma less_event : forall o e, In o (domain m) -> In (o, e) m' -> In (o, e) m.
Proof.
  intros o e I J. apply in_domain in I as [f I]. assert (K := less_assigned _ I).
  apply (seen_iff _ m' o) in J, K; auto. replace e with f by congruence. exact I.
Qed.

Lemma less_all : forall n, AllThere t r m n -> AllThere t r m' n.
Proof. intros n A o I. now apply less_domain, A. Qed.

Lemma less_time : forall n z, AllThere t r m n -> (IsTime t r m' (End n) z <-> IsTime t r m (End n) z).
Proof.
  intros n z A. simpl. unfold Bounds. split; intros [(o & e & P & I & T) B]; split.
  - exists o, e. split; [auto | split; [apply less_event; auto | auto]].
  - intros p Q. destruct (B p Q) as (f & y & J & U). exists f, y. split; [apply less_event; auto | auto].
  - exists o, e. auto.
  - intros p Q. destruct (B p Q) as (f & y & J & U). exists f, y. auto.
Qed.

Lemma less_decided : forall n d i, AllThere t r m n -> i < length h -> DecidedAt t r h' position' m' n d i ->
  DecidedAt t r h position m n d i.
Proof.
  intros n d i A L (_ & P & e & z & ends & N & T & E & G). split; [auto | split].
  - intros o I. rewrite same_positions by now apply A. auto.
  - exists e, z, ends. refine (conj _ (conj T (conj (proj1 (less_time n ends A) E) G))).
    destruct (nth_error h i) as [f |] eqn:Q; [| apply nth_error_None in Q; lia]. apply less_trace in Q. congruence.
Qed.

Lemma all_there_dec : forall n, {AllThere t r m n} + {exists o, InPart t r n o /\ ~ In o (domain m)}.
Proof.
  intros n. destruct (forallb (fun o => among o (domain m)) (part n)) eqn:A.
  - left. intros o I. rewrite forallb_forall in A. now apply among_iff, A, part_iff.
  - right. assert (X : exists o, In o (part n) /\ among o (domain m) = false).
    { clear - A. induction (part n) as [| o l IH]; [discriminate |]. simpl in A.
      destruct (among o (domain m)) eqn:Q; [| exists o; simpl; auto]. destruct (IH A) as (p & I & J).
      exists p; simpl; auto. }
    destruct X as (o & I & Q). exists o. split; [now apply part_iff |]. intros J. apply among_iff in J. congruence.
Qed.

Lemma less_breaks : forall a n c i, Breaks t r h position m a n c i -> Breaks t r h' position' m' a n c i.
Proof.
  intros a n c i (MB & NU & e & a' & N & L & S & F & G).
  assert (B : i < length h) by (apply nth_error_Some; congruence).
  assert (TH : forall o, There t r m n o -> There t r m' n o) by (intros o [I J]; split; auto; now apply less_domain).
  assert (NEW : forall o, In o (domain m') -> In o (domain m) \/ i < position' o).
  { intros o I. destruct (others_later o I); auto. right; lia. }
  split; [| split].
  - destruct (side_of c) as [| d | d]; simpl in *.
    + destruct MB as [(o & T & P) A]. split.
      * exists o. split; auto. rewrite <- same_positions; auto. apply T.
      * intros A'. destruct (all_there_dec n) as [X | (o' & X & Y)].
        -- destruct (A X) as (o' & T' & P'). exists o'. split; auto. rewrite <- same_positions; auto. apply T'.
        -- exists o'. split; [split; auto |]. destruct (NEW o'); auto. contradiction.
    + destruct MB as (A & P & (f & z & ends & N' & T & E & Z) & D). split; [now apply less_all | split; [| split]].
      * intros o I. rewrite <- same_positions; auto.
      * exists f, z, ends. refine (conj (less_trace _ _ N') (conj T (conj (proj2 (less_time n ends A) E) Z))).
      * intros (j & J & D'). apply D. exists j. split; auto. apply less_decided; auto. lia.
    + destruct MB as ((o & T) & P & Z). split; [eauto | split].
      * intros o' [I J]. destruct (NEW o' J) as [K | K]; auto. rewrite <- same_positions; auto. apply P. now split.
      * destruct d as [d |]; auto. destruct Z as (f & z & o' & f' & z' & N' & T' & TH' & I & T'' & Z).
        exists f, z, o', f', z'.
          refine (conj (less_trace _ _ N') (conj T' (conj (TH _ TH') (conj _ (conj T'' Z))))). auto.
  - intros (o & I & Q). destruct (NEW o I) as [J | J]; [| lia]. apply NU. exists o. split; auto.
    now rewrite same_positions.
  - exists e, a'. refine (conj (less_trace _ _ N) (conj L (conj S (conj F G)))).
Qed.

Lemma less_holds : forall a n c, AbsenceHolds t r h' position' m' a n c -> AbsenceHolds t r h position m a n c.
Proof.
  intros a n c [D B]. split.
  - intros H A. destruct (D H (less_all n A)) as (z & Z). exists z. now apply less_time.
  - intros K i X. assert (K' : AbsenceKnown t m' c).
    { intros x I S. destruct (K x I S) as (p & J & R). exists p. split; auto. now apply less_domain. }
    now apply (B K' i), less_breaks.
Qed.
End Less.

(** ** The tests *)

Section Test.
Variable t : tree.
Variable guards : list guard.
Variable part : nat -> list occurrence.
Variable clauses : list (nat * absence).

Definition all_there (n : nat) (m : placed event) : bool := forallb (fun o => among o (domain m)) (part n).

(** The positions and the defined times of the events of a part. *)
Definition own_places (n : nat) (m : placed event) : list nat :=
  flat_map (fun x => if among (fst x) (part n) then [fst (snd x)] else []) m.
Definition own_times (n : nat) (m : placed event) : list Z :=
  flat_map (fun x => if among (fst x) (part n)
                     then match time_of (snd (snd x)) with Some z => [z] | None => [] end else []) m.

(** The positions that decide [for D after]. *)
Definition decisions (n : nat) (d : Z) (h : list event) (m : placed event) : list nat :=
  match time_at part (forget m) (End n) with
  | Some ends =>
    let places := own_places n m in
    let limit := (ends + d + match lateness t with Some l => l | None => 0 end)%Z in
    if all_there n m
    then map fst (filter (fun x => match time_of (snd x) with
                                   | Some z => Z.ltb limit z && forallb (fun j => j <? fst x) places
                                   | None => false
                                   end) (numbered 0 h))
    else []
  | None => []
  end.

Definition may_break (n : nat) (s : side) (h : list event) (m : placed event) : nat -> event -> bool :=
  let places := own_places n m in
  match s with
  | During =>
    let all := all_there n m in
    fun i _ => existsb (fun j => j <? i) places && (negb all || existsb (fun j => i <? j) places)
  | After d =>
    let all := all_there n m in
    let ends := time_at part (forget m) (End n) in
    let decided := decisions n d h m in
    fun i e => all && forallb (fun j => j <? i) places &&
      match time_of e, ends with Some z, Some ends => Z.leb z (ends + d) | _, _ => false end &&
      negb (existsb (fun j => j <? i) decided)
  | Before None => fun i _ => negb (is_nil places) && forallb (fun j => i <? j) places
  | Before (Some d) =>
    let own := own_times n m in
    fun i e => negb (is_nil places) && forallb (fun j => i <? j) places &&
      match time_of e with Some z => existsb (fun z' => Z.leb (z' - d) z) own | None => false end
  end.

Definition absence_known (c : absence) (m : assigned event) : bool :=
  forallb (fun x => implb (shared t x) (member x (bound_variables t m))) (absence_variables c).

(** The event is the absent one, with the values of shared variables. *)
Definition is_absent (c : absence) (bs : binding nat) (e : event) : bool :=
  negb (late e) &&
  existsb (fun cs =>
      forallb (fun y => implb (shared t (fst y)) (value_eqb (get Nat.eqb bs (fst y)) (snd y))) cs &&
      match absent_when c with
      | Some g => holds (fun x => if shared t x then get Nat.eqb bs x else get Nat.eqb cs x) (fun _ => None) g
      | None => true
      end) (bindings (absent c) (content e)).

Definition absence_holds (h : list event) (m : placed event) (bs : binding nat) (x : nat * absence) : bool :=
  let (n, c) := x in
  (if has_duration (side_of c) && all_there n m
   then match time_at part (forget m) (End n) with Some _ => true | None => false end else true) &&
  (if absence_known c (forget m)
   then let used := map (fun x => fst (snd x)) m in
        let may := may_break n (side_of c) h m in
        forallb (fun y => negb (may (fst y) (snd y) && negb (existsb (Nat.eqb (fst y)) used) &&
          is_absent c bs (snd y))) (numbered 0 h)
   else true).

Definition unbroken_by (h : list event) (m : placed event) : bool :=
  let asked := filter (known t part (forget m)) guards in
  existsb (fun bs => solves part asked (forget m) bs && forallb (absence_holds h m bs) clauses) (unions t (forget m)).

Definition decided_by (h : list event) (m : placed event) : bool :=
  forallb (fun x => match side_of (snd x) with
                    | After d => negb (is_nil (decisions (fst x) d h m))
                    | _ => true
                    end) clauses.

(** *** What they say *)

Variable r : resolution.
Hypothesis part_iff : forall n o, In o (part n) <-> InPart t r n o.
Hypothesis guards_iff : forall g, In g guards <-> exists n, In n (map fst r) /\ In g (guards_at t n).
Hypothesis clauses_iff : forall n c, In (n, c) clauses <-> In n (map fst r) /\ In c (without (node_at t n)).
Hypothesis variables_bound : forall n c x, In c (without (node_at t n)) -> In x (absence_variables c) ->
  In x (pattern_variables (absent c)) \/ shared t x = true.

Lemma in_numbered : forall (h : list event) i e, In (i, e) (numbered 0 h) <-> nth_error h i = Some e.
Proof.
  intros h i e. split.
  - intros I. apply In_nth_error in I as [j J]. apply nth_numbered in J as [-> J]. exact J.
  - intros N. apply nth_error_In with i. now apply nth_numbered.
Qed.

Lemma shared_iff : forall x, shared t x = true <-> exists n p, on (node_at t n) = Some p /\
  In x (pattern_variables p) /\ is_own t (n, 0) x = false.
Proof.
  intros x. unfold shared. rewrite existsb_exists. split.
  - intros (n & _ & H). destruct (on (node_at t n)) as [p |] eqn:O; [| discriminate].
    apply andb_true_iff in H as [H K]. exists n, p. repeat split; auto;
      [now apply member_iff | now apply negb_true_iff].
  - intros (n & p & O & I & N). exists n. split.
    + apply in_seq. split; [lia |]. destruct (le_lt_dec (length (nodes t)) n) as [L | L]; [| lia].
      unfold node_at in O. rewrite nth_overflow in O by auto. discriminate.
    + rewrite O, N, andb_true_r. now apply member_iff.
Qed.

Lemma shared_name : forall x, shared t x = true -> x < fresh t.
Proof.
  intros x S. apply shared_iff in S as (n & p & O & I & _). apply (in_names t n). unfold names_at. rewrite O.
  apply in_app_iff; auto.
Qed.

Section Assignment.
Variable h : list event.
Variable m : placed event.
Variable position : occurrence -> nat.
Hypothesis once : NoDup (domain m).
Hypothesis at_position : forall o k e, In (o, (k, e)) m -> position o = k.
Notation m0 := (forget m).

Lemma forget_once : NoDup (domain m0).
Proof. now rewrite forget_domain. Qed.

Lemma in_forgotten : forall o e, In (o, e) m0 <-> In (o, (position o, e)) m.
Proof.
  intros o e. unfold forget. rewrite in_map_iff. split.
  - intros ([o' [k e']] & Q & I). simpl in Q. injection Q as -> ->. now rewrite (at_position _ _ _ I).
  - intros I. exists (o, (position o, e)); auto.
Qed.

Lemma all_there_iff : forall n, all_there n m = true <-> AllThere t r m0 n.
Proof.
  intros n. unfold all_there, AllThere. rewrite forget_domain.
  rewrite forallb_forall. split; intros H o I; [apply among_iff, H, part_iff | apply among_iff, H, part_iff]; auto.
Qed.

Lemma in_own_places : forall n j, In j (own_places n m) <-> exists o, There t r m0 n o /\ position o = j.
Proof.
  intros n j. unfold own_places. rewrite in_flat_map. split.
  - intros ([o [k e]] & I & J). simpl in J. destruct (among o (part n)) eqn:A; [| destruct J].
    destruct J as [<- | []]. exists o. split; [split |].
    + now apply part_iff, among_iff.
    + rewrite forget_domain. apply in_domain; eauto.
    + eapply at_position; eauto.
  - intros (o & [I J] & <-). rewrite forget_domain in J. apply in_domain in J as [[k e] J].
    exists (o, (k, e)). split; auto. simpl. rewrite (proj2 (among_iff o (part n))) by now apply part_iff.
    simpl; left. symmetry. eapply at_position; eauto.
Qed.

Lemma in_own_times : forall n z, In z (own_times n m) <-> exists o f, There t r m0 n o /\ In (o, f) m0 /\
  time_of f = Some z.
Proof.
  intros n z. unfold own_times. rewrite in_flat_map. split.
  - intros ([o [k e]] & I & J). simpl in J. destruct (among o (part n)) eqn:A; [| destruct J].
    destruct (time_of e) as [y |] eqn:T; [| destruct J]. destruct J as [<- | []]. exists o, e.
    assert (K : In (o, e) m0) by (apply in_forgotten; now rewrite (at_position _ _ _ I)).
    split; [split; [now apply part_iff, among_iff | apply in_domain; eauto] | auto].
  - intros (o & f & [I _] & J & T). apply in_forgotten in J. exists (o, (position o, f)). split; auto. simpl.
    rewrite (proj2 (among_iff o (part n))) by now apply part_iff. rewrite T. simpl; auto.
Qed.

Lemma ends_iff : forall n z, time_at part m0 (End n) = Some z <-> IsTime t r m0 (End n) z.
Proof. intros n z. apply time_at_iff; [apply forget_once | exact part_iff]. Qed.

Lemma places_before : forall n i, AllThere t r m0 n ->
  (forallb (fun j => j <? i) (own_places n m) = true <-> forall o, InPart t r n o -> position o < i).
Proof.
  intros n i A. rewrite forallb_forall. split.
  - intros H o I. apply Nat.ltb_lt, H, in_own_places. exists o. split; auto. split; auto.
  - intros H j I. apply in_own_places in I as (o & [I _] & <-). apply Nat.ltb_lt; auto.
Qed.

Lemma in_decisions : forall n d i, In i (decisions n d h m) <-> DecidedAt t r h position m0 n d i.
Proof.
  intros n d i. unfold decisions, DecidedAt. destruct (time_at part m0 (End n)) as [ends |] eqn:E.
  - destruct (all_there n m) eqn:A.
    + apply all_there_iff in A. rewrite in_map_iff. split.
      * intros ([j e] & Q & I). simpl in Q. subst j. apply filter_In in I as [I F]. simpl in F.
        apply in_numbered in I. destruct (time_of e) as [z |] eqn:T; [| discriminate].
        apply andb_true_iff in F as [G P]. apply Z.ltb_lt in G. rewrite (places_before n i A) in P.
        split; [auto | split; [auto |]]. exists e, z, ends.
        refine (conj I (conj T (conj (proj1 (ends_iff n ends) E) G))).
      * intros (_ & P & e & z & ends' & N & T & E' & G). apply ends_iff in E'. rewrite E in E'. injection E' as <-.
        exists (i, e). split; auto. apply filter_In. split; [now apply in_numbered |]. simpl. rewrite T.
        apply andb_true_iff. split; [now apply Z.ltb_lt | now apply places_before].
    + split; [intros [] |]. intros (B & _). apply all_there_iff in B. congruence.
  - split; [intros [] |]. intros (_ & _ & e & z & ends' & _ & _ & E' & _). apply ends_iff in E'. congruence.
Qed.

Lemma places_after : forall n i, forallb (fun j => i <? j) (own_places n m) = true <->
  forall o, There t r m0 n o -> i < position o.
Proof.
  intros n i. rewrite forallb_forall. split.
  - intros H o I. apply Nat.ltb_lt, H, in_own_places. eauto.
  - intros H j I. apply in_own_places in I as (o & I & <-). apply Nat.ltb_lt; auto.
Qed.

Lemma some_place : forall n (f : nat -> bool), existsb f (own_places n m) = true <->
  exists o, There t r m0 n o /\ f (position o) = true.
Proof.
  intros n f. rewrite existsb_exists. split.
  - intros (j & I & F). apply in_own_places in I as (o & I & <-). eauto.
  - intros (o & I & F). exists (position o). split; auto. apply in_own_places. eauto.
Qed.

Lemma no_places : forall n, negb (is_nil (own_places n m)) = true <-> exists o, There t r m0 n o.
Proof.
  intros n. rewrite negb_true_iff, <- not_true_iff_false, is_nil_iff. split.
  - intros N. destruct (own_places n m) as [| j l] eqn:Q; [congruence |].
    assert (I : In j (own_places n m)) by (rewrite Q; simpl; auto). apply in_own_places in I as (o & I & _). eauto.
  - intros (o & I) N. assert (J : In (position o) (own_places n m)) by (apply in_own_places; eauto).
    rewrite N in J. destruct J.
Qed.

Lemma may_break_iff : forall n s i e, nth_error h i = Some e ->
  (may_break n s h m i e = true <-> MayBreak t r h position m0 n s i).
Proof.
  intros n s i e N. destruct s as [| d | [d |]]; cbn [may_break MayBreak].
  - rewrite andb_true_iff, orb_true_iff, negb_true_iff, !some_place. setoid_rewrite Nat.ltb_lt. split.
    + intros [A B]. split; [exact A |]. intros C. destruct B as [B | B]; [| exact B]. apply all_there_iff in C.
      congruence.
    + intros [A B]. split; [exact A |]. destruct (all_there n m) eqn:C; [right | left; reflexivity].
      apply B. now apply all_there_iff.
  - rewrite !andb_true_iff, negb_true_iff, <- not_true_iff_false, existsb_exists. split.
    + intros [[[A P] T] D]. apply all_there_iff in A. rewrite (places_before n i A) in P.
      destruct (time_of e) as [z |] eqn:Z; [| discriminate].
      destruct (time_at part m0 (End n)) as [ends |] eqn:E; [| discriminate]. apply ends_iff in E.
      apply Z.leb_le in T.
      split; [auto | split; [auto | split]].
      * exists e, z, ends. auto.
      * intros (j & L & J). apply D. exists j. split; [now apply in_decisions | now apply Nat.ltb_lt].
    + intros (A & P & (f & z & ends & N' & Z & E & T) & D). rewrite N in N'. injection N' as <-.
      split; [split; [split |] |].
      * now apply all_there_iff.
      * now apply places_before.
      * rewrite Z. apply ends_iff in E. rewrite E. now apply Z.leb_le.
      * intros (j & J & L). apply D. exists j. split; [now apply Nat.ltb_lt | now apply in_decisions].
  - rewrite !andb_true_iff, no_places, places_after. split.
    + intros [[A P] T]. split; [auto | split; [auto |]]. destruct (time_of e) as [z |] eqn:Z; [| discriminate].
      apply existsb_exists in T as (z' & I & T). apply in_own_times in I as (o & f & TH & I & T').
      exists e, z, o, f, z'. apply Z.leb_le in T. auto 8.
    + intros (A & P & f & z & o & f' & z' & N' & Z & TH & I & T' & T). rewrite N in N'. injection N' as <-.
      split; [auto |]. rewrite Z. apply existsb_exists. exists z'.
      split; [apply in_own_times; eauto | now apply Z.leb_le].
  - rewrite !andb_true_iff, no_places, places_after. tauto.
Qed.

Lemma absence_known_iff : forall c, absence_known c m0 = true <-> AbsenceKnown t m0 c.
Proof.
  intros c. unfold absence_known, AbsenceKnown. rewrite forallb_forall.
  assert (V : forall x, shared t x = true -> (member x (bound_variables t m0) = true <->
    exists p, In p (domain m0) /\ (exists q, on (node_at t (fst p)) = Some q /\ In x (pattern_variables q)) /\
      is_own t p x = false)).
  { intros x S. assert (L := shared_name x S). apply shared_iff in S as (n & _ & _ & _ & N).
    rewrite member_iff. unfold bound_variables. rewrite in_flat_map.
    assert (B := name_bound t m0 (n, 0) x L). unfold rename in B. rewrite N in B. unfold GivesValue in B.
    rewrite N in B.
    rewrite <- B. split.
    - intros (p & I & J). destruct (pattern_at t p) as [q |] eqn:Q; [| destruct J]. exists p, q; auto.
    - intros (p & q & I & Q & J). exists p. split; auto. now rewrite Q. }
  split.
  - intros H x I S. apply V; auto. specialize (H x I). now rewrite S in H.
  - intros H x I. destruct (shared t x) eqn:S; auto. simpl. apply V; auto.
Qed.

Variable bs : binding nat.
Variable a : nat -> value.
Hypothesis bound_values : forall x, In x (bound_variables t m0) -> get Nat.eqb bs x = a x.

Lemma is_absent_iff : forall n c e, In c (without (node_at t n)) -> AbsenceKnown t m0 c ->
  (is_absent c bs e = true <-> late e = false /\ exists a',
    (forall x, shared t x = true -> a' x = a x) /\ fits_pattern a' (absent c) (content e) /\
    match absent_when c with Some g => holds a' (fun _ => None) g = true | None => True end).
Proof.
  intros n c e IC K. unfold is_absent. rewrite andb_true_iff, negb_true_iff, existsb_exists.
  assert (B : forall x, In x (absence_variables c) -> shared t x = true -> get Nat.eqb bs x = a x).
  { intros x I S. apply bound_values, member_iff. apply absence_known_iff in K. unfold absence_known in K.
    rewrite forallb_forall in K. specialize (K x I). now rewrite S in K. }
  assert (PV : forall cs y, In cs (bindings (absent c) (content e)) -> In y cs -> In (fst y) (absence_variables c)).
  { intros cs y I J. apply in_app_iff; left. apply (bindings_names (absent c) (content e) cs); auto.
    now apply in_map. }
  assert (GV : forall g x, absent_when c = Some g -> In x (variables g) -> In x (absence_variables c)).
  { intros g x Q X. apply in_app_iff; right. now rewrite Q. }
  apply and_iff_compat_l. split.
  - intros (cs & I & H). apply andb_true_iff in H as [H G]. rewrite forallb_forall in H.
    exists (fun x => if shared t x then a x else get Nat.eqb cs x). split; [intros x S; now rewrite S | split].
    + apply bindings_iff. exists cs. split; auto. intros x v J. specialize (H (x, v) J). simpl in H.
      destruct (shared t x) eqn:S.
      * rewrite <- B by (auto; apply (PV cs (x, v)); auto). now apply value_eqb_iff.
      * now apply (bindings_agree (absent c) (content e) cs I).
    + destruct (absent_when c) as [g |] eqn:Q; auto. rewrite <- G. apply holds_same; auto. intros x X.
      destruct (shared t x) eqn:S; auto. symmetry. apply B; eauto.
  - intros (a' & S & F & G). apply bindings_iff in F as (cs & I & R). exists cs. split; auto.
    apply andb_true_iff. split.
    + apply forallb_forall. intros [x v] J. simpl. destruct (shared t x) eqn:SX; auto. simpl. apply value_eqb_iff.
      rewrite B by (auto; apply (PV cs (x, v)); auto). rewrite <- S by auto. now apply R.
    + destruct (absent_when c) as [g |] eqn:Q; auto. rewrite <- G. apply holds_same; auto. intros x X.
      destruct (shared t x) eqn:SX; [rewrite B by eauto; symmetry; auto |].
      apply (respects_get Nat.eqb Nat.eqb_eq); auto. apply (bindings_variables (absent c) (content e)); auto.
      destruct (variables_bound n c x IC (GV g x eq_refl X)); [auto | congruence].
Qed.

Lemma absence_holds_iff : forall n c, In c (without (node_at t n)) ->
  (absence_holds h m bs (n, c) = true <-> AbsenceHolds t r h position m0 a n c).
Proof.
  intros n c IC. unfold absence_holds, AbsenceHolds. rewrite andb_true_iff. apply and_iff.
  - destruct (has_duration (side_of c)); cbn [andb]; [| split; [intros _ Q; discriminate | auto]].
    destruct (all_there n m) eqn:A.
    + apply all_there_iff in A. destruct (time_at part m0 (End n)) as [z |] eqn:E.
      * split; auto. intros _ _ _. exists z. now apply ends_iff.
      * split; [discriminate |]. intros H. destruct (H eq_refl A) as (z & Z). apply ends_iff in Z. congruence.
    + split; auto. intros _ _ B. apply all_there_iff in B. congruence.
  - destruct (absence_known c m0) eqn:K.
    + apply absence_known_iff in K. rewrite forallb_forall. split.
      * intros H _ i (MB & NU & e & a' & N & L & S & F & G). assert (I := proj2 (in_numbered h i e) N).
        specialize (H _ I).
        simpl in H. apply negb_true_iff in H. rewrite <- not_true_iff_false in H. apply H.
        rewrite !andb_true_iff. split; [split |].
        -- now apply may_break_iff.
        -- apply negb_true_iff, not_true_iff_false. rewrite existsb_exists. intros (k & J & Q). apply Nat.eqb_eq in Q.
           subst k. apply in_map_iff in J as ([o [k f]] & Q & J). simpl in Q. subst k. apply NU. exists o.
           split; [rewrite forget_domain; apply in_domain; eauto | eapply at_position; eauto].
        -- apply (is_absent_iff n); auto. split; auto. exists a'; auto.
      * intros H [i e] I. simpl. apply in_numbered in I. apply negb_true_iff, not_true_iff_false.
        rewrite !andb_true_iff.
        intros [[MB NU] IA]. apply (is_absent_iff n) in IA as (L & a' & S & F & G); auto.
        apply (H K i). split; [now apply may_break_iff in MB | split; [| exists e, a'; auto]].
        intros (o & D & Q). apply negb_true_iff in NU. rewrite <- not_true_iff_false in NU. apply NU.
        rewrite forget_domain in D. apply in_domain in D as [[k f] D]. apply existsb_exists. exists k. split.
        -- apply in_map_iff. exists (o, (k, f)); auto.
        -- apply Nat.eqb_eq. rewrite <- Q. eapply at_position; eauto.
    + split; auto. intros _ X. apply absence_known_iff in X. congruence.
Qed.
End Assignment.

(** *** An assignment that is not broken *)

Lemma unbroken_by_iff : forall h m position, NoDup (domain m) ->
  (forall o k e, In (o, (k, e)) m -> position o = k) ->
  (unbroken_by h m = true <-> exists a, Under t guards part a (forget m) /\
     forall n c, In (n, c) clauses -> AbsenceHolds t r h position (forget m) a n c).
Proof.
  intros h m position N P. unfold unbroken_by. rewrite existsb_exists. split.
  - intros (bs & I & H). apply andb_true_iff in H as [S H]. rewrite forallb_forall in H.
    exists (get Nat.eqb bs). split.
    + apply under_iff. exists bs. split; [auto | split; [| auto]]. apply agree_respects.
      unfold solves in S. now apply andb_true_iff in S as [S _].
    + intros n c J. assert (C := proj1 (clauses_iff n c) J). specialize (H _ J).
      apply (absence_holds_iff h m position N P bs (get Nat.eqb bs)); [auto | apply C | exact H].
  - intros (a & U & H). apply under_iff in U as (bs & I & R & S). exists bs. split; auto.
    apply andb_true_iff. split; auto. apply forallb_forall. intros [n c] J.
    assert (C := proj1 (clauses_iff n c) J). apply (absence_holds_iff h m position N P bs a); auto; [| apply C].
    intros x X. apply (respects_get Nat.eqb Nat.eqb_eq); auto. eapply unions_variables; eauto.
Qed.

(** A clause looks only at the variables that it shares with the tree. *)
Lemma holds_shared : forall h position m a a' n c, (forall x, shared t x = true -> a x = a' x) ->
  AbsenceHolds t r h position m a n c -> AbsenceHolds t r h position m a' n c.
Proof.
  intros h position m a a' n c S [D B]. split; auto. intros K i (MB & NU & e & a0 & N & L & V & H).
  apply (B K i). split; [auto | split; [auto |]]. exists e, a0. split; [auto | split; [auto | split; auto]].
  intros x X. rewrite S by auto. now apply V.
Qed.

Lemma place_position : forall k pos (m : assigned event) o j e, In (o, (j, e)) (place k pos m) -> k + pos o = j.
Proof. intros k pos m o j e I. apply in_map_iff in I as ([p f] & Q & _). simpl in Q. now injection Q as -> <- _. Qed.

Theorem unbroken_iff : forall h k pos m, NoDup (domain m) ->
  (forall o, In o (domain m) -> snd o < times (node_at t (fst o))) ->
  (unbroken_by h (place k pos m) = true <-> Unbroken t r h (fun o => k + pos o) m).
Proof.
  intros h k pos m N B. rewrite (unbroken_by_iff h _ (fun o => k + pos o));
    [| now rewrite place_domain | apply place_position].
  rewrite forget_place. destruct (under_names t guards part r part_iff guards_iff m N B) as [U1 U2]. split.
  - intros (a & U & H). exists a, (fun o x => a (own_name t o x)). split; auto.
    intros n c I J. apply H, clauses_iff; auto.
  - intros (a & own & U & H). exists (named_values t a own). split; auto.
    intros n c I. apply clauses_iff in I as [I J]. apply (holds_shared h _ m a); auto.
    intros x S. unfold named_values. now rewrite (proj2 (Nat.ltb_lt _ _) (shared_name x S)).
Qed.

Lemma decided_by_iff : forall h m position, NoDup (domain m) ->
  (forall o k e, In (o, (k, e)) m -> position o = k) ->
  (decided_by h m = true <-> Decided t r h position (forget m)).
Proof.
  intros h m position N P. unfold decided_by, Decided. rewrite forallb_forall. split.
  - intros H n c d I J S. assert (K := H (n, c) (proj2 (clauses_iff n c) (conj I J))). simpl in K. rewrite S in K.
    apply negb_true_iff in K. destruct (decisions n d h m) as [| i l] eqn:Q; [discriminate |].
    exists i. apply (in_decisions h m position N P). rewrite Q. simpl; auto.
  - intros H [n c] I. apply clauses_iff in I as [I J]. simpl. destruct (side_of c) as [| d | d] eqn:S; auto.
    destruct (H n c d I J S) as (i & D). apply (in_decisions h m position N P) in D.
    destruct (decisions n d h m); [destruct D | auto].
Qed.

(** *** The laws of the search *)

Definition position_in (m : placed event) (o : occurrence) : nat := match seen m o with Some x => fst x | None => 0 end.

Lemma position_in_iff : forall m, NoDup (domain m) -> forall o k e, In (o, (k, e)) m -> position_in m o = k.
Proof. intros m N o k e I. unfold position_in. now rewrite (proj2 (seen_iff _ m o (k, e) N) I). Qed.

Lemma forget_incl : forall m m' : placed event, incl m m' -> incl (forget m) (forget m').
Proof. intros m m' I x X. apply in_map_iff in X as (y & <- & X). apply in_map_iff. eauto. Qed.

Lemma unbroken_less : forall h h' m m', NoDup (domain m) -> NoDup (domain m') -> incl m m' ->
  (forall i e, nth_error h i = Some e -> nth_error h' i = Some e) ->
  (forall o k e, In (o, (k, e)) m' -> In o (domain m) \/ length h <= k) ->
  unbroken_by h' m' = true -> unbroken_by h m = true.
Proof.
  intros h h' m m' N N' I T L. set (position := position_in m').
  assert (P' : forall o k e, In (o, (k, e)) m' -> position o = k) by now apply position_in_iff.
  assert (P : forall o k e, In (o, (k, e)) m -> position o = k) by eauto.
  rewrite (unbroken_by_iff h' m' position N' P'), (unbroken_by_iff h m position N P).
  intros (a & U & H). exists a. split.
  - apply (under_part t guards part r part_iff a (forget m')); auto;
      [now rewrite forget_domain | now rewrite forget_domain |].
    now apply forget_incl.
  - intros n c J. apply (less_holds t r part part_iff h h' position position (forget m) (forget m')); auto.
    + now apply forget_incl.
    + now rewrite forget_domain.
    + intros o O. rewrite forget_domain in *. apply in_domain in O as [[k e] O]. rewrite (P' _ _ _ O). eauto.
Qed.

Lemma decided_same : forall h m m', NoDup (domain m) -> Permutation m m' -> decided_by h m' = true ->
  decided_by h m = true.
Proof.
  intros h m m' N PM. assert (N' : NoDup (domain m')) by (apply (Permutation_NoDup (Permutation_map fst PM) N)).
  assert (S : forall x, In x m <-> In x m').
  { intros x; split; apply Permutation_in; auto. now apply Permutation_sym. }
  set (position := position_in m').
  assert (P' : forall o k e, In (o, (k, e)) m' -> position o = k) by now apply position_in_iff.
  assert (P : forall o k e, In (o, (k, e)) m -> position o = k) by (intros o k e I; apply (P' o k e), S, I).
  rewrite (decided_by_iff h m' position N' P'), (decided_by_iff h m position N P).
  assert (D : forall o, In o (domain (forget m)) <-> In o (domain (forget m'))).
  { intros o. rewrite !forget_domain, !in_domain. split; intros [x X]; exists x; now apply S. }
  intros H n c d I J Q. destruct (H n c d I J Q) as (i & DE). exists i. assert (DE' := DE).
  destruct DE' as (A & _ & e & _ & _ & E & _).
  apply (less_decided t r h h position position (forget m) (forget m')); auto.
  - apply forget_incl. intros x X. now apply S.
  - now rewrite forget_domain.
  - intros o O. apply D, A, O.
  - apply nth_error_Some. congruence.
Qed.

Variable os : list occurrence.
Variable before : occurrence -> occurrence -> bool.

Definition watched_here : watched event :=
  Watched (Plan os before (consistent t guards part)) unbroken_by decided_by.

Theorem absence_watchable : watchable watched_here.
Proof.
  assert (PERM : forall (m m' : placed event), NoDup (domain m) -> Permutation m m' -> NoDup (domain m'))
    by (intros m m' N P; apply (Permutation_NoDup (Permutation_map fst P) N)).
  constructor; simpl.
  - apply (consistent_lawful t guards part r part_iff).
  - intros h m m' N P. assert (N' := PERM m m' N P). assert (P' := Permutation_sym P).
    assert (ANY : forall m m' : placed event, NoDup (domain m) -> NoDup (domain m') -> Permutation m m' ->
      unbroken_by h m' = true -> unbroken_by h m = true).
    { intros l l' M M' Q. apply unbroken_less; auto.
      - intros x X. now apply (Permutation_in _ Q).
      - intros o k e I. left. apply (Permutation_in _ (Permutation_sym Q)) in I. apply in_domain; eauto. }
    apply eq_true_iff_eq. split; [apply (ANY m' m) | apply (ANY m m')]; auto.
  - intros h m m' N P. apply eq_true_iff_eq. split; [apply (decided_same h m' m) | apply (decided_same h m m')]; auto.
    + eapply PERM; eauto.
    + now apply Permutation_sym.
  - intros h e m m' N' IT X. apply unbroken_less; auto.
    + destruct X as [-> | (o & ->)]; auto. simpl in N'. now inversion N'.
    + destruct X as [-> | (o & ->)]; [apply incl_refl | apply incl_tl, incl_refl].
    + intros i f. apply nth_app_some.
    + intros o k f I. destruct X as [-> | (p & ->)]; [left; apply in_domain; eauto |].
      destruct I as [Q | I]; [right | left; apply in_domain; eauto]. injection Q as _ <- _. lia.
Qed.
End Test.

(** ** The scenarios of a tree *)

Definition absences_of (t : tree) (r : resolution) : list (nat * absence) :=
  flat_map (fun n => map (pair n) (without (node_at t n))) (map fst r).

Lemma absences_of_iff : forall t r n c, In (n, c) (absences_of t r) <->
  In n (map fst r) /\ In c (without (node_at t n)).
Proof.
  intros t r n c. unfold absences_of. rewrite in_flat_map. split.
  - intros (k & I & J). apply in_map_iff in J as (d & Q & J). injection Q as -> ->. auto.
  - intros [I J]. exists n. split; auto. now apply in_map.
Qed.

Definition all_watched (t : tree) (w : selection) : list (watched event) :=
  let keep := selected t w in
  flat_map (fun r =>
    let clauses := absences_of t r in
    each_scenario (fun guards part os before => watched_here t guards part clauses os before) t r)
    (filter keep (resolutions t)).

Lemma in_watched : forall t w q, In q (all_watched t w) <->
  exists r chosen, In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\
    In chosen (lasts t r) /\
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    acyclic before (occurrences_of t r) = true /\
    q = watched_here t (guards_of t r) (parts t r) (absences_of t r) (occurrences_of t r) before.
Proof.
  intros t w q.
  exact (in_each_scenario _ (fun r guards part os before => watched_here t guards part (absences_of t r) os before) t w q).
Qed.

Theorem all_watchable : forall t w, WellFormed t -> Forall watchable (all_watched t w).
Proof.
  intros t w W. apply Forall_forall. intros q I. apply in_watched in I as (r & chosen & I & _ & _ & _ & _ & ->).
  apply resolutions_iff in I; auto. apply (absence_watchable t _ _ _ r);
    [now apply parts_iff | apply absences_of_iff |].
  apply (absence_bound t W).
Qed.

Lemma tests_iff : forall t past r trace position m, WellFormed t -> In r (resolutions t) -> NoDup (domain m) ->
  incl (domain m) (occurrences_of t r) ->
  (unbroken_by t (guards_of t r) (parts t r) (absences_of t r) (past ++ trace) (place (length past) position m) = true
    <-> Unbroken t r (past ++ trace) (fun o => length past + position o) m) /\
  (decided_by t (parts t r) (absences_of t r) (past ++ trace) (place (length past) position m) = true
    <-> Decided t r (past ++ trace) (fun o => length past + position o) m).
Proof.
  intros t past r trace position m W I ND IN. apply resolutions_iff in I; auto. split.
  - apply (unbroken_iff t _ _ _ r); auto.
    + now apply parts_iff.
    + intros; apply guards_of_iff.
    + apply absences_of_iff.
    + apply (absence_bound t W).
    + intros o O. apply IN, occurrences_iff in O. apply O.
  - rewrite (decided_by_iff t _ _ r) with (position := fun o => length past + position o).
    + now rewrite forget_place.
    + now apply parts_iff.
    + apply absences_of_iff.
    + now rewrite place_domain.
    + apply place_position.
Qed.

Theorem watched_sound : forall t w past q, WellFormed t -> In q (all_watched t w) ->
  IsScenario t w past (denoted_after past q).
Proof.
  intros t w past q W I. apply in_watched in I as (r & chosen & I & K & C & J & A & ->).
  destruct (plan_facts t w r chosen W I K C J A) as (R & S & L & F & P & CO).
  exists r, (last_in chosen). repeat (split; [assumption |]). simpl.
  split; [intros o; apply occurrences_iff | split; [auto | split; [auto |]]].
  intros trace position m ND IN _. now apply tests_iff.
Qed.

Theorem watched_complete : forall t w past c, WellFormed t -> IsScenario t w past c ->
  exists q, In q (all_watched t w) /\ Alike c (denoted_after past q).
Proof.
  intros t w past c W H. destruct (scenario_plan t w past c W H) as (r & chosen & I & S & C & L & A & O & B & M & U).
  set (q := watched_here t (guards_of t r) (parts t r) (absences_of t r) (occurrences_of t r)
    (precedes (node_pairs t r) (end_pairs t r (last_in chosen)))).
  assert (IQ : In q (all_watched t w)) by (apply in_watched; exists r, chosen; auto 7).
  exists q. split; auto. constructor; simpl; auto.
  intros trace position m ND IN K. destruct (U trace position m ND IN K) as [-> ->].
  destruct (tests_iff t past r trace position m W I ND) as [UN DE].
  { intros o P. now apply O, IN. }
  split; symmetry; assumption.
Qed.

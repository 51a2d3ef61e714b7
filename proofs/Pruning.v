(** * Dropping partial matches without changing a verdict

    Of two partial matches with the same occurrences, one may be dropped if every continuation of it
    is also a continuation of the other one.  The search below keeps each partial match with a key,
    and drops a new one if a kept one has a key that covers its own.  It also tries only the
    occurrences that an event can serve. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search.
Import ListNotations.

Section Pruning.
Context {E K : Type}.
Variable relevant : E -> bool.

(** [m'] can do what [m] can do. *)
Record Le (c : plan E) (m m' : assigned E) : Prop := {
  le_once : NoDup (domain m) /\ NoDup (domain m');
  le_domain : forall o, In o (domain m) <-> In o (domain m');
  le_future : forall x, NoDup (domain (x ++ m)) -> incl (domain x) (plan_occurrences c) ->
    plan_consistent c (x ++ m) = true -> plan_consistent c (x ++ m') = true }.

Lemma le_refl : forall c m, NoDup (domain m) -> Le c m m.
Proof. constructor; auto; tauto. Qed.

Lemma domain_app : forall (x m : assigned E), domain (x ++ m) = domain x ++ domain m.
Proof. intros; unfold domain; apply map_app. Qed.

Lemma NoDup_app_iff : forall A (l m : list A), NoDup (l ++ m) <-> NoDup l /\ NoDup m /\ forall x, In x l -> ~ In x m.
Proof.
  induction l as [| a l IH]; simpl; intros m.
  - split; [intros H; repeat split; auto; constructor | tauto].
  - rewrite !NoDup_cons_iff, IH, in_app_iff. split.
    + intros (N & H1 & H2 & H3). repeat split; auto. intros x [<- | I]; auto.
    + intros ((N & H1) & H2 & H3). repeat split; auto. intros [I | I]; auto. apply (H3 a); auto.
Qed.

Lemma le_trans : forall c a b d, Le c a b -> Le c b d -> Le c a d.
Proof.
  intros c a b d [[A1 A2] A3 A4] [[B1 B2] B3 B4]. constructor; auto.
  - intros o; now rewrite A3.
  - intros x N I H. apply B4; auto. rewrite domain_app in *. apply NoDup_app_iff in N as (N1 & N2 & N3).
    apply NoDup_app_iff. repeat split; auto. intros y Y. rewrite <- A3. auto.
Qed.

Lemma le_full : forall c m m', Le c m m' -> full c m = full c m'.
Proof.
  intros c m m' [_ D _]. unfold full. apply eq_true_iff_eq. rewrite !forallb_forall.
  split; intros H o I; apply H, among_iff in I; apply among_iff; now apply D.
Qed.

(** A continuation of [m] by an event is covered by one of [m']. *)
Lemma le_extend : forall c e m m' x, Le c m m' -> In x (extend c e m) -> exists x', In x' (extend c e m') /\ Le c x x'.
Proof.
  intros c e m m' x L H. destruct L as [[N N'] D F].
  apply (in_extend relevant) in H as (o & -> & Ho & No & P & C).
  assert (N1 : NoDup (domain ((o, e) :: m))) by (simpl; constructor; auto).
  assert (C' : plan_consistent c ((o, e) :: m') = true).
  { apply (F [(o, e)]); auto. intros y [<- | []]; auto. }
  exists ((o, e) :: m'). split.
  - apply (in_extend relevant). exists o; repeat split; auto.
    + now rewrite <- D.
    + intros p Hp B. apply D; auto.
  - constructor.
    + split; auto. simpl; constructor; auto. now rewrite <- D.
    + intros p; simpl; now rewrite D.
    + intros y Ny I H. change (y ++ (o, e) :: m') with (y ++ [(o, e)] ++ m').
      change (y ++ (o, e) :: m) with (y ++ [(o, e)] ++ m) in Ny, H. rewrite app_assoc in *.
      apply F; auto. rewrite domain_app. intros z Z. apply in_app_iff in Z as [Z | [<- | []]]; auto.
Qed.

(** ** The search with keys *)

(** A scenario with the occurrences that an event may serve, and the key of a partial match. *)
Record tracked := Tracked {
  plan_of : plan E;
  candidates : E -> list occurrence;
  key_of : assigned E -> K }.

Variable covered : K -> K -> bool.

Record Sound (q : tracked) : Prop := {
  sound_lawful : lawful (plan_of q);
  sound_candidates : forall e, incl (candidates q e) (plan_occurrences (plan_of q));
  all_candidates : forall e o m, In o (plan_occurrences (plan_of q)) ->
    plan_consistent (plan_of q) ((o, e) :: m) = true -> In o (candidates q e);
  sound_keys : forall m m', NoDup (domain m) -> NoDup (domain m') ->
    incl (domain m) (plan_occurrences (plan_of q)) ->
    plan_consistent (plan_of q) m = true -> plan_consistent (plan_of q) m' = true ->
    covered (key_of q m) (key_of q m') = true -> Le (plan_of q) m m' }.

Definition keyed (q : tracked) (m : assigned E) : K * assigned E := (key_of q m, m).

Fixpoint add_new (kept new : list (K * assigned E)) : list (K * assigned E) :=
  match new with
  | [] => kept
  | km :: new => add_new (if existsb (fun other => covered (fst km) (fst other)) kept then kept else km :: kept) new
  end.

Definition extend_by (c : plan E) (os : list occurrence) (e : E) (m : assigned E) : list (assigned E) :=
  flat_map (fun o =>
    if negb (among o (domain m))
       && forallb (fun p => implb (plan_before c p o) (among p (domain m))) (plan_occurrences c)
       && plan_consistent c ((o, e) :: m)
    then [(o, e) :: m] else []) os.

Definition extensions (q : tracked) (e : E) (l : list (K * assigned E)) : list (assigned E) :=
  match candidates q e with
  | [] => []
  | os => flat_map (fun km => extend_by (plan_of q) os e (snd km)) l
  end.

(** The kept partial matches after an event, and whether one of the new ones is complete. *)
Definition pruned_step (s : semantics) (q : tracked) (e : E) (l : list (K * assigned E)) : list (K * assigned E) *
  bool :=
  let after (kept : list (K * assigned E)) :=
    let new := extensions q e l in (add_new kept (map (keyed q) new), existsb (full (plan_of q)) new) in
  match s with
  | Strict => after []
  | Projected => if relevant e then after [] else (l, false)
  | Consecutive => if relevant e then after (map (keyed q) (start (plan_of q))) else (l, false)
  | Scattered => after l
  end.

Inductive pruned_monitor := Finished | Active (l : list (tracked * list (K * assigned E))).

Definition pruned_init (qs : list tracked) : pruned_monitor :=
  if existsb (fun q => existsb (full (plan_of q)) (start (plan_of q))) qs then Finished
  else Active (map (fun q => (q, map (keyed q) (start (plan_of q)))) qs).

Definition pruned_advance (s : semantics) (m : pruned_monitor) (e : E) : pruned_monitor :=
  match m with
  | Finished => Finished
  | Active l =>
    let stepped := map (fun x => (fst x, pruned_step s (fst x) e (snd x))) l in
    if existsb (fun y => snd (snd y)) stepped then Finished else Active (map (fun y => (fst y, fst (snd y))) stepped)
  end.

Definition pruned_verdict (m : pruned_monitor) : verdict :=
  match m with
  | Finished => Top
  | Active l => if forallb (fun x => is_nil (snd x)) l then Bottom else Unknown
  end.

Definition pruned_run s qs (trace : list E) : pruned_monitor := fold_left (pruned_advance s) trace (pruned_init qs).

(** ** The kept partial matches cover all *)

Definition Covers (c : plan E) (l : list (assigned E)) (kept : list (assigned E)) : Prop :=
  incl kept l /\ forall m, In m l -> exists m', In m' kept /\ Le c m m'.

Lemma in_extend_by : forall q e m x, Sound q ->
  (In x (extend_by (plan_of q) (candidates q e) e m) <-> In x (extend (plan_of q) e m)).
Proof.
  intros q e m x S. unfold extend_by, extend. rewrite !in_flat_map. split; intros (o & I & H); exists o; split; auto.
  - now apply (sound_candidates q S e).
  - destruct (_ && _) eqn:C in H; [| destruct H]. apply andb_true_iff in C as [_ C]. eapply (all_candidates q S); eauto.
Qed.

Lemma in_extensions : forall q e l x, Sound q ->
  (In x (extensions q e l) <-> exists m, In m (map snd l) /\ In x (extend (plan_of q) e m)).
Proof.
  intros q e l x S.
  assert (H : In x (extensions q e l) <->
    In x (flat_map (fun km => extend_by (plan_of q) (candidates q e) e (snd km)) l)).
  { unfold extensions. destruct (candidates q e) eqn:C; [| tauto]. simpl. split; [intros [] |].
    intros I. apply in_flat_map in I as (km & _ & I). unfold extend_by in I. destruct I. }
  rewrite H, in_flat_map. split.
  - intros ([k m] & I & J). apply in_extend_by in J; auto. exists m; split; auto. apply in_map_iff. exists (k, m); auto.
  - intros (m & I & J). apply in_map_iff in I as ([k m'] & Q & I). simpl in Q; subst. exists (k, m); split; auto.
    apply in_extend_by; auto.
Qed.

Lemma add_new_spec : forall q kept new, Sound q ->
  (forall km, In km kept \/ In km new -> fst km = key_of q (snd km) /\ NoDup (domain (snd km)) /\
     incl (domain (snd km)) (plan_occurrences (plan_of q)) /\ plan_consistent (plan_of q) (snd km) = true) ->
  (forall km, In km (add_new kept new) -> In km kept \/ In km new) /\
  (forall m, In m (map snd kept) \/ In m (map snd new) ->
    exists m', In m' (map snd (add_new kept new)) /\ Le (plan_of q) m m').
Proof.
  intros q kept new S; revert kept. induction new as [| km new IH]; intros kept H.
  - simpl. split; [auto |]. intros m [I | []]. exists m; split; auto. apply le_refl.
    apply in_map_iff in I as (k & <- & I). now destruct (H k (or_introl I)) as (_ & N & _).
  - cbn [add_new]. destruct (existsb (fun other => covered (fst km) (fst other)) kept) eqn:X.
    + destruct (IH kept) as [A B]; [intros k [I | I]; apply H; simpl; auto |]. split.
      * intros k I. apply A in I as [I | I]; simpl; auto.
      * intros m [I | [<- | I]]; auto.
        apply existsb_exists in X as (other & J & Q).
        destruct (H km) as (K1 & N1 & I1 & C1); [simpl; auto |]. destruct (H other) as (K2 & N2 & I2 & C2); [auto |].
        destruct (B (snd other)) as (m' & J' & L); [left; now apply in_map |]. exists m'; split; auto.
        eapply le_trans; eauto. apply (sound_keys q S); auto. now rewrite <- K1, <- K2.
    + destruct (IH (km :: kept)) as [A B]; [intros k [[<- | I] | I]; apply H; simpl; auto |]. split.
      * intros k I. apply A in I as [[<- | I] | I]; simpl; auto.
      * intros m [I | [<- | I]]; apply B; simpl; auto.
Qed.

Section Run.
Variable s : semantics.
Variable q : tracked.
Hypothesis S : Sound q.
Notation c := (plan_of q).
Notation states := (states relevant s (plan_of q)).

Lemma states_valid : forall u m, In m (states u) ->
  NoDup (domain m) /\ incl (domain m) (plan_occurrences c) /\ plan_consistent c m = true.
Proof.
  intros u m I. apply states_sound in I as (pos & P & _); [| apply S].
  split; [apply (once _ _ _ _ P) | split; [apply (of_scenario _ _ _ _ P) | apply (conditions_hold _ _ _ _ P)]].
Qed.

(** The kept partial matches have their keys, and cover the states of the search. *)
Definition Good (u : list E) (l : list (K * assigned E)) : Prop :=
  (forall km, In km l -> fst km = key_of q (snd km)) /\ Covers c (states u) (map snd l).

Lemma good_start : Good [] (map (keyed q) (start c)).
Proof.
  split.
  - intros km I. apply in_map_iff in I as (m & <- & _); auto.
  - rewrite map_map; simpl. rewrite map_id. split; [apply incl_refl |].
    intros m I. exists m; split; auto. apply le_refl. now apply (states_valid []).
Qed.

Lemma cover_extensions : forall u l e, Good u l ->
  (forall x, In x (extensions q e l) -> exists m, In m (states u) /\ In x (extend c e m)) /\
  (forall m x, In m (states u) -> In x (extend c e m) -> exists x', In x' (extensions q e l) /\ Le c x x').
Proof.
  intros u l e [_ [I C]]. split.
  - intros x J. apply in_extensions in J as (m & J & X); auto. exists m; auto.
  - intros m x J X. destruct (C m J) as (m' & J' & L). destruct (le_extend c e m m' x L X) as (x' & X' & L').
    exists x'; split; auto. apply in_extensions; eauto.
Qed.

Lemma good_step : forall u l e, Good u l -> Good (u ++ [e]) (fst (pruned_step s q e l)).
Proof.
  intros u l e G. assert (G' := G). destruct G' as [KEY [INC COV]].
  destruct (cover_extensions u l e G) as [X1 X2].
  assert (IN : forall x, In x (flat_map (extend c e) (states u)) <-> exists m, In m (states u) /\ In x (extend c e m))
    by (intros; apply in_flat_map).
  (* adding the new partial matches to kept ones that cover [base] *)
  assert (ADD : forall kept base,
    (forall km, In km kept -> fst km = key_of q (snd km)) -> Covers c base (map snd kept) ->
    states (u ++ [e]) = base ++ flat_map (extend c e) (states u) ->
    Good (u ++ [e]) (add_new kept (map (keyed q) (extensions q e l)))).
  { intros kept base KEY' [INC' COV'] ST.
    assert (V : forall km, In km kept \/ In km (map (keyed q) (extensions q e l)) ->
      In (snd km) (states (u ++ [e])) /\ fst km = key_of q (snd km)).
    { intros km [I | I].
      - split; auto. rewrite ST. apply in_app_iff; left. apply INC'. now apply in_map.
      - apply in_map_iff in I as (x & <- & I). split; auto. simpl. rewrite ST. apply in_app_iff; right.
        apply IN; auto. }
    destruct (add_new_spec q kept (map (keyed q) (extensions q e l)) S) as [A B].
    { intros km I. apply V in I as [I Q]. apply states_valid in I. tauto. }
    split; [intros km I; apply A, V in I; tauto |]. split.
    - intros m I. apply in_map_iff in I as (km & <- & I). apply A, V in I; tauto.
    - intros m I. rewrite ST in I. apply in_app_iff in I as [I | I].
      + destruct (COV' m I) as (m' & J & L). destruct (B m') as (m'' & J' & L'); [auto |].
        exists m''; split; auto. eapply le_trans; eauto.
      + apply IN in I as (m0 & I & X). destruct (X2 m0 m I X) as (x' & X' & L).
        destruct (B x') as (m'' & J' & L'); [right; rewrite map_map; simpl; now rewrite map_id |].
        exists m''; split; auto. eapply le_trans; eauto. }
  assert (SAME : states (u ++ [e]) = states u -> Good (u ++ [e]) l).
  { intros Q. split; auto. rewrite Q. split; auto. }
  assert (EMPTY : Covers c [] (map snd ([] : list (K * assigned E)))) by (split; [apply incl_refl | intros ? []]).
  assert (ST := states_snoc relevant s c u e). unfold pruned_step. destruct s; simpl in ST |- *.
  - apply (ADD [] []); simpl; auto. intros ? [].
  - destruct (relevant e); [apply (ADD [] []); simpl; auto; intros ? [] | now apply SAME].
  - destruct (relevant e); [| now apply SAME]. apply (ADD _ (start c)); auto; apply good_start.
  - apply (ADD l (Search.states relevant Scattered c u)); auto. split; auto.
Qed.

(** While nothing is detected, the test of the new partial matches is the test of all. *)
Lemma full_step : forall u l e, Good u l -> existsb (full c) (states u) = false -> existsb (full c) (start c) = false ->
  snd (pruned_step s q e l) = existsb (full c) (states (u ++ [e])).
Proof.
  intros u l e G N1 N2. destruct (cover_extensions u l e G) as [X1 X2].
  assert (NEW : existsb (full c) (extensions q e l) = existsb (full c) (flat_map (extend c e) (states u))).
  { apply eq_true_iff_eq. rewrite !existsb_exists. split.
    - intros (x & I & F). apply X1 in I as (m & I & J). exists x; split; auto. apply in_flat_map; eauto.
    - intros (x & I & F). apply in_flat_map in I as (m & I & J). destruct (X2 m x I J) as (x' & I' & L).
      exists x'; split; auto. now rewrite <- (le_full _ _ _ L). }
  assert (ST := states_snoc relevant s c u e). unfold pruned_step. destruct s; simpl in ST |- *.
  - now rewrite ST.
  - destruct (relevant e); simpl; rewrite ST; auto.
  - destruct (relevant e); simpl; rewrite ST; auto. now rewrite existsb_app, N2.
  - now rewrite ST, existsb_app, N1.
Qed.
End Run.

Lemma covers_nil : forall c l l', Covers c l l' -> is_nil l = is_nil l'.
Proof.
  intros c [| x l] [| y l'] [I C]; auto.
  - destruct (I y); simpl; auto.
  - destruct (C x) as (m & [] & _); simpl; auto.
Qed.

(** The search with keys has the verdicts of the search. *)
Theorem pruned_correct : forall s qs u, Forall Sound qs ->
  pruned_verdict (pruned_run s qs u) = verdict_of (run relevant s (map plan_of qs) u).
Proof.
  intros s qs u SO. rewrite Forall_forall in SO.
  assert (INV : (pruned_run s qs u = Finished /\ run relevant s (map plan_of qs) u = Done) \/
    (exists ls, pruned_run s qs u = Active (combine qs ls) /\ length ls = length qs /\
       Forall2 (fun q l => Good s q u l) qs ls /\
       run relevant s (map plan_of qs) u = Running (snapshot relevant s (map plan_of qs) u))).
  { induction u as [| e u IH] using rev_ind.
    - change (run relevant s (map plan_of qs) []) with (settle (snapshot relevant s (map plan_of qs) [])).
      rewrite settle_snapshot. unfold pruned_run, pruned_init; simpl. rewrite existsb_map.
      unfold Search.states; simpl. destruct (existsb _ qs) eqn:X; [left; auto | right].
      exists (map (fun q => map (keyed q) (start (plan_of q))) qs). split; [| split; [apply map_length | split; auto]].
      + f_equal. clear. induction qs; simpl; f_equal; auto.
      + assert (G : forall q, In q qs -> Good s q [] (map (keyed q) (start (plan_of q)))) by (intros;
          apply good_start; auto).
        clear - G. induction qs; simpl; constructor; [apply G; simpl; auto | apply IHqs; intros; apply G; simpl; auto].
    - unfold pruned_run in *. rewrite fold_left_app, run_snoc. simpl.
      destruct IH as [[-> ->] | (ls & -> & LEN & G & R)]; [left; auto |].
      assert (NF : forall w v c, u = w ++ v -> In c (map plan_of qs) ->
        existsb (full c) (Search.states relevant s c w) = false).
      { destruct (run_spec relevant s (map plan_of qs) u) as [[D _] | [_ N]]; [congruence | auto]. }
      rewrite R. cbn [advance pruned_advance].
      replace (map (fun x => (fst x, step relevant s (fst x) e (snd x))) (snapshot relevant s (map plan_of qs) u))
        with (snapshot relevant s (map plan_of qs) (u ++ [e]))
        by (generalize (map plan_of qs); intros; unfold snapshot; rewrite map_map; apply map_ext; intros;
            apply f_equal, states_snoc).
      set (stepped := map (fun x => (fst x, pruned_step s (fst x) e (snd x))) (combine qs ls)).
      rewrite settle_snapshot, existsb_map.
      assert (F : existsb (fun y : tracked * (list (K * assigned E) * bool) => snd (snd y)) stepped =
                  existsb (fun q => existsb (full (plan_of q)) (Search.states relevant s (plan_of q) (u ++ [e]))) qs).
      { assert (Q : forall q l, In q qs -> Good s q u l ->
          snd (pruned_step s q e l) = existsb (full (plan_of q)) (Search.states relevant s (plan_of q) (u ++ [e]))).
        { intros q l I Gq. apply full_step; auto.
          - apply (NF u []); [now rewrite app_nil_r | now apply in_map].
          - apply (NF [] u); [auto | now apply in_map]. }
        unfold stepped. clear - Q G. induction G as [| q l qs ls Gq G IH]; simpl; auto.
        rewrite (Q q l) by (simpl; auto). f_equal. apply IH. intros; apply Q; simpl; auto. }
      rewrite F. destruct (existsb _ qs); [left; auto | right].
      exists (map (fun x => fst (pruned_step s (fst x) e (snd x))) (combine qs ls)). split; [| split; [| split; auto]].
      + f_equal. unfold stepped. rewrite map_map. simpl. clear - LEN. revert ls LEN.
        induction qs as [| q qs IH]; intros [| l ls] LEN; simpl in *; try discriminate; auto. f_equal. apply IH; lia.
      + rewrite map_length, combine_length. lia.
      + assert (Q : forall q l, In q qs -> Good s q u l -> Good s q (u ++ [e]) (fst (pruned_step s q e l)))
          by (intros; apply good_step; auto).
        clear - Q G. induction G as [| q l qs ls Gq G IH]; simpl; constructor; [apply Q; simpl; auto |].
        apply IH; intros; apply Q; simpl; auto. }
  destruct INV as [[-> ->] | (ls & -> & LEN & G & ->)]; auto. simpl.
  replace (forallb (fun x => is_nil (snd x)) (combine qs ls))
    with (forallb (fun x => is_nil (snd x)) (snapshot relevant s (map plan_of qs) u)); auto.
  clear - G. induction G as [| q l qs ls Gq G IH]; simpl; auto. rewrite IH. f_equal.
  destruct Gq as [_ C]. rewrite (covers_nil _ _ _ C). destruct l; auto.
Qed.

Theorem pruned_is_verdict : forall s qs u, Forall Sound qs ->
  Verdict (fun e => relevant e = true) (Scenarios (map plan_of qs)) s u (pruned_verdict (pruned_run s qs u)).
Proof.
  intros s qs u H. rewrite pruned_correct by auto. apply verdict_correct.
  rewrite Forall_forall in *. intros c I. apply in_map_iff in I as (q & <- & I). apply H; auto.
Qed.
End Pruning.
Arguments tracked E K : clear implicits.
Arguments pruned_monitor E K : clear implicits.

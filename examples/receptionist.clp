; Gives each visitor to an idle guide, as the coordination scripts of the NBSA paper do; for experts.
;
;   robotree create examples/receptionist.clp as reception
;   robotree enslave reception.guide_1 companion-1
;   robotree enslave reception.guide_2 companion-2
;   robotree call reception.start --detach
;   robotree call reception.person_seen who=Anna place=kitchen

(defscript receptionist "Gives each visitor to an idle guide."
  (partner guide_1 (kind Companion) (needs say go_to) (takes place kitchen hall) (doc "a guide"))
  (partner guide_2 (kind Companion) (needs say go_to) (takes place kitchen hall) (optional) (doc "another guide"))
  (hears person_seen (who text) (place text)))

(deftemplate guide (slot name) (slot state (default idle)))
(deftemplate visitor (slot id) (slot place) (slot guide (default none)) (slot stage (default waiting)))

(defrule a-guide-is-there
  (partner (name ?g) (state here))
  (not (guide (name ?g)))
  => (assert (guide (name ?g))))

(defrule greet-arrival "somebody stands at ?p who is not known yet"
  (msg (perf inform) (act person_seen) (args ?who ?p))
  (not (visitor (id ?who)))
  => (assert (visitor (id ?who) (place ?p))))

(defrule assign "an idle guide takes the visitor"
  ?v <- (visitor (id ?who) (place ?p) (guide none))
  ?r <- (guide (name ?g) (state idle))
  =>
  (modify ?r (state busy))
  (modify ?v (guide ?g) (stage going))
  (do ?g go_to place= ?p))

(defrule talk-when-there
  (msg (perf inform) (from ?g) (act done) (args go_to $?))
  ?v <- (visitor (id ?who) (guide ?g) (stage going))
  => (modify ?v (stage talking)) (do ?g say text= (str-cat "Welcome, " ?who)))

(defrule finished
  (msg (perf inform) (from ?g) (act done) (args say $?))
  ?v <- (visitor (guide ?g) (stage talking))
  ?r <- (guide (name ?g))
  => (retract ?v) (modify ?r (state idle)))

(defrule guide-failed "the visitor is given to another guide"
  (declare (salience 10))
  (msg (perf failure) (from ?g) (args ?why $?))
  ?v <- (visitor (id ?who) (guide ?g))
  ?r <- (guide (name ?g))
  =>
  (log ?g " failed: " ?why)
  (modify ?v (guide none) (stage waiting))
  (modify ?r (state broken)))

(defrule guide-lost
  (declare (salience 20))
  (msg (act lost) (from ?g))
  ?r <- (guide (name ?g))
  => (retract ?r))

(defrule lost-with-a-visitor
  (declare (salience 30))
  (msg (act lost) (from ?g))
  ?v <- (visitor (guide ?g))
  => (modify ?v (guide none) (stage waiting)))

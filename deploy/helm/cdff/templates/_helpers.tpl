{{/* Name of an object of the release; services of the profile have underscores, which Kubernetes refuses. */}}
{{- define "cdff.name" -}}
{{- printf "%s-%s" .root.Release.Name .part | replace "_" "-" | trunc 63 | trimSuffix "-" -}}
{{- end -}}

{{/* The profile as a mapping, with its errors. */}}
{{- define "cdff.profile" -}}
{{- if not .Values.profile }}{{ fail "profile is empty: give the mission profile with --set-file profile=FILE" }}{{ end -}}
{{- $profile := fromYaml .Values.profile -}}
{{- if hasKey $profile "Error" }}{{ fail (printf "profile is no YAML mapping: %s" $profile.Error) }}{{ end -}}
{{- if not $profile.robots }}{{ fail "profile: no robots; expected the text of a mission profile" }}{{ end -}}
{{- $robots := list -}}
{{- range $profile.robots }}{{ $robots = append $robots .id }}{{ end -}}
{{- range .Values.scopes -}}
{{- if not (has . (prepend $robots "ground")) -}}
{{- fail (printf "scopes: %s; the profile has ground, %s" . (join ", " $robots)) -}}
{{- end -}}
{{- end -}}
{{- toYaml $profile -}}
{{- end -}}

{{/* Whether a scope runs in the cluster: "true" or nothing. */}}
{{- define "cdff.runs" -}}
{{- if or (not .root.Values.scopes) (has .scope .root.Values.scopes) }}true{{ end -}}
{{- end -}}

{{- define "cdff.labels" -}}
app.kubernetes.io/name: cdff
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .component }}
{{- end -}}

{{- define "cdff.metadata" -}}
name: {{ include "cdff.name" . }}
namespace: {{ .root.Release.Namespace }}
labels:
  {{- include "cdff.labels" . | nindent 2 }}
  app.kubernetes.io/part: {{ .part | replace "_" "-" }}
  app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
  app.kubernetes.io/managed-by: {{ .root.Release.Service }}
  helm.sh/chart: {{ .root.Chart.Name }}-{{ .root.Chart.Version }}
{{- end -}}

{{/* Labels that select the pods of one part. */}}
{{- define "cdff.selector" -}}
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/part: {{ .part | replace "_" "-" }}
{{- end -}}

{{- define "cdff.connect" -}}
{{- ternary "tls" "tcp" .root.Values.identities.enabled }}/{{ include "cdff.name" (dict "root" .root "part" "router") }}:7447
{{- end -}}

{{/*
Pod template. Arguments: root, part, component, image, command, scope (of the identity), tokens (of the health check), resources,
and optionally environment (list), environmentFrom (list), ports (list), volume (claim of the data), mounts, volumes, probes.
*/}}
{{- define "cdff.pod" -}}
metadata:
  labels:
    {{- include "cdff.labels" . | nindent 4 }}
    app.kubernetes.io/part: {{ .part | replace "_" "-" }}
  annotations:
    checksum/profile: {{ printf "%s%s" .root.Values.profile (toYaml .root.Values.profileFiles) | sha256sum }}
spec:
  automountServiceAccountToken: false
  enableServiceLinks: false
  terminationGracePeriodSeconds: 15
  securityContext:
    runAsNonRoot: true
    runAsUser: 10001
    runAsGroup: 10001
    fsGroup: 10001
    fsGroupChangePolicy: OnRootMismatch
    seccompProfile: {type: RuntimeDefault}
  {{- with .root.Values.images.pullSecrets }}
  imagePullSecrets: {{- range . }}
    - name: {{ . }}
  {{- end }}{{ end }}
  {{- with .root.Values.nodeSelector }}
  nodeSelector: {{- toYaml . | nindent 4 }}
  {{- end }}
  {{- with .root.Values.tolerations }}
  tolerations: {{- toYaml . | nindent 4 }}
  {{- end }}
  containers:
    - name: {{ .component }}
      image: {{ .root.Values.images.registry }}{{ .image }}:{{ .root.Values.images.tag }}
      imagePullPolicy: {{ .root.Values.images.pullPolicy }}
      command: {{- toYaml .command | nindent 8 }}
      env:
        - {name: CDFF_CONNECT, value: {{ include "cdff.connect" . | quote }}}
        - {name: CDFF_PROFILE, value: /etc/cdff/profile.yaml}
        - {name: CDFF_LOG_LEVEL, value: {{ .root.Values.logLevel | quote }}}
        {{- if .root.Values.identities.enabled }}
        - {name: CDFF_IDENTITY, value: /run/identity}
        {{- end }}
        {{- with .environment }}{{ toYaml . | nindent 8 }}{{ end }}
      {{- with .environmentFrom }}
      envFrom: {{- toYaml . | nindent 8 }}
      {{- end }}
      {{- with .ports }}
      ports: {{- toYaml . | nindent 8 }}
      {{- end }}
      {{- if .probes }}
      {{- toYaml .probes | nindent 6 }}
      {{- else }}
      {{- $test := dict "command" (concat (list "python" "-m" "services.health") .tokens) }}
      startupProbe: {periodSeconds: 5, timeoutSeconds: 8, failureThreshold: 36, exec: {{ toJson $test }}}
      readinessProbe: {periodSeconds: 10, timeoutSeconds: 8, failureThreshold: 3, exec: {{ toJson $test }}}
      {{- $alive := dict "command" (concat (list "python" "-m" "services.health" "--without-router") .tokens) }}
      livenessProbe: {periodSeconds: 20, timeoutSeconds: 15, failureThreshold: 6, exec: {{ toJson (ternary $test $alive (eq .part "router")) }}}
      {{- end }}
      resources: {{- toYaml .resources | nindent 8 }}
      securityContext:
        allowPrivilegeEscalation: false
        # Kernels of numba are compiled into a folder of the image, which numba must be able to write.
        readOnlyRootFilesystem: {{ has .image (list "cdff-router" "cdff-icu") }}
        capabilities: {drop: [ALL]}
      volumeMounts:
        - {name: profile, mountPath: /etc/cdff, readOnly: true}
        - {name: temporary, mountPath: /tmp}
        - {name: cache, mountPath: /var/cache/cdff}
        {{- if .storage }}
        - {name: data, mountPath: /var/lib/cdff}
        {{- end }}
        {{- if .root.Values.identities.enabled }}
        - {name: identity, mountPath: /run/identity, readOnly: true}
        {{- end }}
        {{- with .mounts }}{{ toYaml . | nindent 8 }}{{ end }}
  volumes:
    - name: profile
      configMap: {name: {{ include "cdff.name" (dict "root" .root "part" "profile") }}}
    - {name: temporary, emptyDir: {}}
    - {name: cache, emptyDir: {}}
    {{- if .root.Values.identities.enabled }}
    - name: identity
      secret: {secretName: {{ printf "%s%s" .root.Values.identities.prefix .scope | replace "_" "-" | quote }}, defaultMode: 0400}
    {{- end }}
    {{- with .volumes }}{{ toYaml . | nindent 4 }}{{ end }}
{{- end -}}

{{/* Claim of a volume that outlives the pod. */}}
{{- define "cdff.claims" -}}
volumeClaimTemplates:
  - metadata: {name: data}
    spec:
      accessModes: [ReadWriteOnce]
      {{- with .className }}
      storageClassName: {{ . }}
      {{- end }}
      resources: {requests: {storage: {{ .size }}}}
{{- end -}}

{{/* A service with one replica and a volume. Arguments: those of cdff.pod, and storage. */}}
{{- define "cdff.statefulset" -}}
apiVersion: apps/v1
kind: StatefulSet
metadata: {{- include "cdff.metadata" . | nindent 2 }}
spec:
  replicas: {{ .replicas | default 1 }}
  serviceName: {{ include "cdff.name" . }}
  podManagementPolicy: Parallel
  {{- with .firstOrdinal }}
  ordinals: {start: {{ . }}}
  {{- end }}
  selector: {matchLabels: {{ include "cdff.selector" . | fromYaml | toJson }}}
  template: {{- include "cdff.pod" . | nindent 4 }}
  {{- include "cdff.claims" .storage | nindent 2 }}
{{- end -}}
